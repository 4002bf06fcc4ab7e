/** Every process: whether it lives, how old its report is, what it uses, what it dropped; and the last events. */

import { element, say } from "./dom.js";
import { amount, clock, figure } from "./words.js";

/** @typedef {import("./protocol.js").ProcessReport} ProcessReport */

const COLUMNS = ["process", "age", "CPU", "memory", "rate", "drops", "rejects"];

/** Each reports once a second; one that is silent for longer may be frozen [s]. */
const SILENT = 3;

export class HealthPanel {
  #table = element("tbody", {});
  #events = element("ol", { className: "events" });
  #shownEvents = "";
  /** @type {Map<string, ProcessRows>} */
  #rows = new Map();

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

  /**
   * Show what is new; nothing while nobody can see it.
   *
   * @param {boolean} live  whether what is shown is what is.
   */
  update(live) {
    if (this.panel.hidden) return;
    const { processes, events } = this.fleet;
    if (Object.keys(processes).join() !== [...this.#rows.keys()].join()) {
      this.#rows = new Map(Object.keys(processes).map((name) => [name, new ProcessRows(name)]));
      this.#table.replaceChildren(...[...this.#rows.values()].flatMap(({ row, more }) => [row, more]));
    }
    for (const [name, rows] of this.#rows) rows.show(/** @type {ProcessReport} */ (processes[name]), live);
    const newest = `${events[0]} ${events.length}`;
    if (newest === this.#shownEvents) return;
    this.#shownEvents = newest;
    this.#events.replaceChildren(
      ...events.map(([, t, process, text]) =>
        element("li", {}, element("time", {}, clock(t)), element("strong", {}, process), element("span", {}, text)),
      ),
    );
    if (events.length === 0) this.#events.append(element("li", { className: "none" }, "Nothing has happened yet."));
  }
}

/** The row of one process, and one below it: what is wrong, and what it receives when that is asked for. */
class ProcessRows {
  #open = false;
  #cells = COLUMNS.slice(1).map(() => element("td", {}));
  #sign = element("span", { className: "alive" });
  #wrong = element("p", { className: "wrong" });
  #inputs = element("p", { className: "hint" });
  #name;

  /** @param {string} name */
  constructor(name) {
    this.#name = element("button", { type: "button", className: "process", ariaExpanded: "false" }, this.#sign, name);
    this.#name.onclick = () => {
      this.#open = !this.#open;
      this.#name.ariaExpanded = String(this.#open);
      this.#inputs.hidden = !this.#open;
      this.more.hidden = !this.#open && !this.#wrong.textContent;
    };
    this.#inputs.hidden = true;
    this.row = element("tr", {}, element("th", { scope: "row" }, this.#name), ...this.#cells);
    this.more = element(
      "tr",
      { className: "more" },
      element("td", { colSpan: COLUMNS.length }, this.#wrong, this.#inputs),
    );
  }

  /**
   * @param {ProcessReport} report
   * @param {boolean} live  whether it is what is.
   */
  show({ alive, state, age, cpu, memory, rates = {}, ages = {}, drops, rejects, reasons = [], complaints = [] }, live) {
    // One that lives and does not say how it is may be frozen: that is no green.
    const silent = age === null || age === undefined || age > SILENT;
    this.#sign.className = !alive ? "dead" : silent || !live ? "silent" : "alive";
    say(this.#sign, alive ? "" : state === "missing" ? "missing" : "gone");
    const fastest = Math.max(...Object.values(rates), -Infinity);
    const words = [
      live ? amount(age, 1, "s") : "old",
      amount(cpu, 0, "%"),
      amount(memory, 0, "MB"),
      Number.isFinite(fastest) ? `${figure(fastest, 0)} Hz` : "–",
      figure(drops, 0),
      figure(rejects, 0),
    ];
    words.forEach((text, index) => say(/** @type {Element} */ (this.#cells[index]), text));
    // A run, or a program of the lab's own, need not report anything; one that did and does no longer is in trouble.
    const unreported = alive && (age === null || age === undefined);
    const frozen = alive && silent && !unreported ? ["it lives, and is silent"] : [];
    say(
      this.#wrong,
      unreported ? "lives; it reports nothing of itself" : [...frozen, ...complaints, ...reasons].join("; "),
    );
    this.#wrong.className = unreported ? "hint" : "wrong";
    const inputs = Object.entries(rates).map(([word, rate]) => {
      const old = ages[word];
      const rest = old === undefined ? "" : `, ${figure(old, 2)} s old`;
      return `${word.replaceAll("_", " ")} ${figure(rate, rate < 10 ? 1 : 0)} Hz${rest}`;
    });
    say(this.#inputs, inputs.length ? `receives ${inputs.join("; ")}` : "does not say what it receives");
    this.more.hidden = !this.#open && !this.#wrong.textContent;
  }
}
