/** Every process: whether it lives, how old its report is, what it uses, what it dropped; and the last events. */

import { element } from "./dom.js";
import { clock, figure } from "./words.js";

/** @typedef {import("./protocol.js").ProcessReport} ProcessReport */

const COLUMNS = ["process", "age", "CPU", "memory", "rate", "drops", "rejects"];

export class HealthPanel {
  #table = element("tbody", {});
  #events = element("ol", { className: "events" });
  #shownEvents = "";

  /**
   * @param {HTMLElement} panel
   * @param {import("./fleet.js").Fleet} fleet
   */
  constructor(panel, fleet) {
    this.panel = panel;
    this.fleet = fleet;
    const heads = COLUMNS.map((title) => element("th", { scope: "col" }, title));
    const table = element(
      "table",
      {},
      element("caption", { className: "away" }, "Processes"),
      element("thead", {}, element("tr", {}, ...heads)),
      this.#table,
    );
    panel.append(
      element("h2", {}, "Processes"),
      element("div", { className: "scroll", tabIndex: 0, role: "region", ariaLabel: "Processes" }, table),
      element("h2", {}, "Events"),
      this.#events,
    );
  }

  /** Show what is new; nothing while nobody can see it. */
  update() {
    if (this.panel.hidden) return;
    const rows = Object.entries(this.fleet.processes).flatMap(([name, report]) => rowsOf(name, report));
    this.#table.replaceChildren(...rows);
    const newest = `${this.fleet.events[0]} ${this.fleet.events.length}`;
    if (newest === this.#shownEvents) return;
    this.#shownEvents = newest;
    this.#events.replaceChildren(
      ...this.fleet.events.map(([, t, process, text]) =>
        element("li", {}, element("time", {}, clock(t)), element("strong", {}, process), element("span", {}, text)),
      ),
    );
    if (this.fleet.events.length === 0) this.#events.append(element("li", { className: "none" }, "Nothing has happened yet."));
  }
}

/**
 * A row, and one more for what is wrong.
 *
 * @param {string} name
 * @param {ProcessReport} report
 */
function rowsOf(name, report) {
  const { alive, age, cpu, memory, rates, drops, rejects, reasons = [], complaints = [] } = report;
  const state = element("span", { className: alive ? "alive" : "dead" }, alive ? "" : "gone");
  const fastest = Math.max(...Object.values(rates ?? {}), -Infinity);
  const cells = [
    element("th", { scope: "row" }, state, name),
    element("td", {}, age === null || age === undefined ? "–" : `${figure(age, 1)} s`),
    element("td", {}, cpu === null || cpu === undefined ? "–" : `${figure(cpu, 0)} %`),
    element("td", {}, memory === null || memory === undefined ? "–" : `${figure(memory, 0)} MB`),
    element("td", {}, Number.isFinite(fastest) ? `${figure(fastest, 0)} Hz` : "–"),
    element("td", {}, figure(drops, 0)),
    element("td", {}, figure(rejects, 0)),
  ];
  const wrong = [...complaints, ...reasons].join("; ");
  const rows = [element("tr", {}, ...cells)];
  if (wrong) rows.push(element("tr", { className: "wrong" }, element("td", { colSpan: COLUMNS.length }, wrong)));
  return rows;
}
