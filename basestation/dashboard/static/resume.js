/** A button that lifts a stop, after a question. What it lifts is the stop that was shown when it asked, no later one. */

import { element } from "./dom.js";

export class ResumeButton {
  #fleet;
  #orders;
  #label;
  #names;
  #sure;

  /**
   * @param {import("./fleet.js").Fleet} fleet
   * @param {import("./orders.js").Orders} orders
   * @param {string} who  is resumed, in words; empty for all robots.
   * @param {string[]} names  the same; none for all.
   * @param {() => void} [sure]  called before the order is given.
   */
  constructor(fleet, orders, who, names, sure = () => {}) {
    this.#fleet = fleet;
    this.#orders = orders;
    this.#label = who ? `Resume ${who}` : "Resume";
    this.#names = names;
    this.#sure = sure;
    this.element = element("div", { className: "resuming" });
    this.#offer();
  }

  #offer() {
    const ask = element("button", { type: "button", className: "quiet", textContent: `${this.#label} …` });
    ask.onclick = () => this.#ask("Is the floor clear?");
    this.element.classList.remove("asking");
    this.element.replaceChildren(ask);
    return ask;
  }

  /** @param {string} question */
  #ask(question) {
    const { revision } = this.#fleet.stop;
    const yes = element("button", { type: "button", className: "main", textContent: "Yes, drive again" });
    const no = element("button", { type: "button", className: "quiet", textContent: "No" });
    no.onclick = () => this.#offer().focus();
    yes.onclick = () => void this.#resume(revision);
    this.element.classList.add("asking");
    this.element.replaceChildren(element("span", {}, question), yes, no);
    no.focus(); // a key that is still held presses this one
  }

  /** @param {number} revision */
  async #resume(revision) {
    this.#offer();
    this.#sure();
    const reply = await this.#orders.give(this.#label, { order: "resume", names: this.#names, revision });
    const changed = this.#fleet.stop.revision !== revision;
    if (reply.outcome === "refused" && changed && this.element.isConnected) {
      this.#ask("Somebody has stopped since. Is the floor clear?");
    }
  }
}
