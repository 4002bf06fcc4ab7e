/** The fields of a table of parameters: each with its unit and its limits. */

import { element } from "./dom.js";

/** @typedef {import("./protocol.js").Parameter} Parameter */

export class ParameterForm {
  /** @type {Map<string, HTMLInputElement | HTMLSelectElement>} */
  #fields = new Map();
  /** @type {Record<string, Parameter>} */
  #table = {};

  /**
   * @param {HTMLElement} where
   * @param {() => void} changed  called when a value has been entered.
   */
  constructor(where, changed) {
    this.where = where;
    this.changed = changed;
  }

  /**
   * Show a table.
   *
   * @param {Record<string, Parameter>} table
   * @param {Record<string, any>} values  those that are in force.
   */
  show(table, values) {
    this.#table = table;
    this.#fields.clear();
    this.where.replaceChildren();
    for (const [key, parameter] of Object.entries(table)) {
      const field = fieldOf(parameter, key in values ? values[key] : parameter.default);
      field.name = key;
      field.required = parameter.required ?? false;
      field.onchange = () => {
        this.#showThoseThatApply();
        if (field.checkValidity() && parse(field, parameter) !== undefined) this.changed();
        else field.reportValidity();
      };
      const unit = parameter.unit ? ` [${parameter.unit}]` : "";
      const doc = (parameter.doc ?? "").replaceAll("``", "").replace(unit, "");
      const label = element("label", { title: doc }, element("span", {}, inWords(key) + unit), field);
      if (doc) label.append(element("small", {}, doc));
      this.where.append(label);
      this.#fields.set(key, field);
    }
    this.#showThoseThatApply();
  }

  /** What was entered, without what is as by default; null when something is not as it must be. */
  values() {
    /** @type {Record<string, any>} */
    const entered = {};
    for (const [key, field] of this.#fields) {
      const parameter = /** @type {Parameter} */ (this.#table[key]);
      if (!this.#applies(parameter)) continue;
      if (!field.checkValidity()) return null;
      const value = parse(field, parameter);
      if (value === undefined) return null;
      if (value === null || JSON.stringify(value) === JSON.stringify(parameter.default)) continue;
      entered[key] = value;
    }
    return entered;
  }

  /**
   * @param {Parameter} parameter
   * @returns {boolean} whether it is there while the others are as they are.
   */
  #applies({ when }) {
    if (!when) return true;
    const [key, choices] = when;
    const above = this.#table[key];
    return choices.includes(this.#fields.get(key)?.value ?? "") && (above === undefined || this.#applies(above));
  }

  #showThoseThatApply() {
    for (const [key, field] of this.#fields) {
      const label = field.closest("label");
      if (label !== null) label.hidden = !this.#applies(/** @type {Parameter} */ (this.#table[key]));
    }
  }
}

/** A key as one reads it; a symbol such as k_o or v_min stays as it is in the laws. @param {string} key */
const inWords = (key) => (/(^|_)[a-z0-9](_|$)|_\d/.test(key) ? key : key.replaceAll("_", " "));

/**
 * @param {Parameter} parameter
 * @param {any} value
 * @returns {HTMLInputElement | HTMLSelectElement}
 */
function fieldOf(parameter, value) {
  const { type, choices } = parameter;
  if (type === "choice" || type === "boolean") {
    const options = type === "boolean" ? ["false", "true"] : (choices ?? []);
    const field = element(
      "select",
      {},
      ...options.map((choice) => element("option", { value: choice }, choice.replaceAll("_", " "))),
    );
    field.value = String(value);
    return field;
  }
  if (type === "number" || type === "integer") {
    const field = element("input", { type: "number", step: type === "integer" ? "1" : "any", inputMode: "decimal" });
    const { at_least, above, at_most, below } = parameter;
    const least = at_least ?? above;
    const most = at_most ?? below;
    if (least !== null && least !== undefined) field.min = String(least);
    if (most !== null && most !== undefined) field.max = String(most);
    // A limit that is not allowed itself.
    field.oninput = () => {
      const number = Number(field.value);
      const outside = field.value !== "" && ((above != null && number <= above) || (below != null && number >= below));
      field.setCustomValidity(
        outside ? `must be ${above != null && number <= above ? `above ${above}` : `below ${below}`}` : "",
      );
    };
    field.value = value === null || value === undefined ? "" : String(value);
    return field;
  }
  return element("input", { type: "text", value: Array.isArray(value) ? JSON.stringify(value) : (value ?? "") });
}

/**
 * @param {HTMLInputElement | HTMLSelectElement} field
 * @param {Parameter} parameter
 * @returns {any} null when nothing was entered, undefined when it cannot be read.
 */
function parse({ value }, { type }) {
  if (value === "") return null;
  if (type === "boolean") return value === "true";
  if (type === "number" || type === "integer") return Number(value);
  if (type !== "array") return value;
  try {
    const list = JSON.parse(value.trim().startsWith("[") ? value : `[${value}]`);
    return Array.isArray(list) ? list : undefined;
  } catch {
    return undefined;
  }
}
