/** Breaking things, in a simulated fleet: what, where, for how long; and what was broken, as a scenario's tables. */

import { element, say } from "./dom.js";
import { ParameterForm } from "./parameter_form.js";
import { figure } from "./words.js";

export class FaultsPanel {
  #made = "";
  #what = element("select", { name: "kind" });
  #where = element("select", { name: "target" });
  #duration = element("input", { type: "number", min: "0.1", step: "any", value: "5", name: "duration", inputMode: "decimal" });
  #doc = element("p", { className: "hint" });
  #done = element("pre", { tabIndex: 0 });
  #numbers;

  /**
   * @param {HTMLElement} panel
   * @param {import("./fleet.js").Fleet} fleet
   * @param {import("./orders.js").Orders} orders
   */
  constructor(panel, fleet, orders) {
    this.panel = panel;
    this.fleet = fleet;
    this.orders = orders;
    const fields = element("div", { className: "fields" });
    this.#numbers = new ParameterForm(fields, () => {});
    this.#what.onchange = () => this.#show();
    this.form = element(
      "form",
      {},
      element("h2", {}, "Break it"),
      element("p", { className: "hint" }, "Only because this fleet is simulated."),
      element("div", { className: "pair" }, element("label", {}, "What", this.#what), element("label", {}, "Where", this.#where)),
      this.#doc,
      fields,
      element("div", { className: "bar" }, element("label", { className: "inline" }, "for [s]", this.#duration), element("button", { type: "submit", className: "main", textContent: "Break" })),
    );
    this.form.onsubmit = (event) => {
      event.preventDefault();
      this.#break();
    };
    const save = element("button", { type: "button", className: "quiet", textContent: "Save" });
    save.onclick = () => this.#save();
    panel.append(this.form, element("div", { className: "bar" }, element("h2", {}, "Done so far"), save), this.#done);
  }

  /** Show what is new. */
  update() {
    const faults = this.fleet.hello?.faults ?? {};
    const made = JSON.stringify([Object.entries(faults).map(([kind, { targets }]) => [kind, targets]), this.fleet.maySteer]);
    if (made !== this.#made) {
      this.#made = made;
      this.#what.replaceChildren(...Object.keys(faults).map((kind) => element("option", { value: kind }, kind.replaceAll("_", " "))));
      this.#show();
      for (const field of this.form.elements) Reflect.set(field, "disabled", !this.fleet.maySteer);
    }
    say(this.#done, this.#asTables() || "Nothing yet.");
  }

  #show() {
    const facts = this.fleet.hello?.faults?.[this.#what.value];
    if (facts === undefined) return;
    const before = this.#where.value;
    this.#where.replaceChildren(...facts.targets.map((target) => element("option", { value: target }, target)));
    if (facts.targets.includes(before)) this.#where.value = before;
    say(this.#doc, facts.doc);
    this.#numbers.show(facts.parameters, {});
  }

  #break() {
    const numbers = this.#numbers.values();
    if (numbers === null) return void this.form.reportValidity();
    const [kind, target] = [this.#what.value, this.#where.value];
    const duration = this.#duration.value === "" ? null : Number(this.#duration.value);
    const words = `Break ${target}: ${kind.replaceAll("_", " ")}`;
    void this.orders.give(words, { order: "break", kind, target, duration, numbers });
  }

  /** What was done, as a scenario file has it. */
  #asTables() {
    return this.fleet.faults
      .map((row) => ["[[fault]]", ...Object.entries(row).map(([key, value]) => `${key} = ${toml(value)}`)].join("\n"))
      .join("\n\n");
  }

  #save() {
    const address = URL.createObjectURL(new Blob([`${this.#asTables()}\n`], { type: "application/toml" }));
    element("a", { href: address, download: "faults.toml" }).click();
    setTimeout(() => URL.revokeObjectURL(address), 1000);
  }
}

/** @param {unknown} value */
function toml(value) {
  return typeof value === "number" && !Number.isInteger(value) ? figure(value, 2).replace("−", "-") : JSON.stringify(value);
}
