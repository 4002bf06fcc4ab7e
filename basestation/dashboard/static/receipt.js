/** What came of a stop: who stands still and after what time, and who did not confirm. */

import { element } from "./dom.js";
import { amount, figure } from "./words.js";

/** @typedef {import("./protocol.js").Reply} Reply */

/** What is known of a robot that nobody has heard of. */
const UNKNOWN = {
  status: "no agent",
  latched_after_s: null,
  at_rest_after_s: null,
  travelled_m: null,
  silent_s: null,
};

export class Receipt {
  /** @type {HTMLElement} */
  #where;

  /** @param {HTMLElement} where  it is shown. */
  constructor(where) {
    this.#where = where;
    where.classList.add("receipt");
  }

  /**
   * Show a line, in place of what was shown before.
   *
   * @param {"" | "waiting" | "good" | "bad"} kind
   * @param {string} words
   */
  show(kind, words) {
    this.#where.className = `receipt ${kind}`;
    this.#where.replaceChildren(element("p", {}, words));
  }

  /**
   * Show what came of a stop.
   *
   * @param {Reply} reply
   * @param {boolean} owed  whether it is sent again.
   * @param {string[]} names  who was to stop; one that the receipt does not know of has not.
   */
  report({ outcome, reason, receipt }, owed, names) {
    if (!receipt) {
      const words = outcome === "refused" ? "The stop was refused" : "The stop was not answered";
      const again = owed ? " It is sent again when there is a new connection." : "";
      this.show("bad", `${words}${reason ? `: ${reason}` : ""}.${again} Switch the robots off if they drive.`);
      return;
    }
    const unknown = names.filter((name) => !(name in receipt.robots));
    const rows = Object.entries({ ...receipt.robots, ...Object.fromEntries(unknown.map((name) => [name, UNKNOWN])) });
    const resting = rows.filter(([, { status }]) => status === "stopped");
    const times = resting.map(([, row]) => row.at_rest_after_s ?? 0);
    if (receipt.confirmed && unknown.length === 0) {
      const longest = times.length ? ` within ${figure(Math.max(...times), 2)} s` : "";
      this.show(
        "good",
        rows.length
          ? `${count(resting.length)} stand${resting.length === 1 ? "s" : ""} still${longest}`
          : "The stop is kept; no robot is known",
      );
    } else {
      this.show("bad", `${resting.length} of ${count(rows.length)} confirmed. Missing:`);
    }
    const missing = rows.filter(([, { status }]) => status !== "stopped");
    const lines = missing.map(([name, { status, silent_s }]) =>
      element(
        "li",
        {},
        element("strong", {}, name),
        ` ${status}${silent_s === null ? "" : `, silent for ${figure(silent_s, 1)} s`}`,
      ),
    );
    this.#where.append(element("ul", { className: "missing" }, ...lines));
    const stand = resting.map(([name, row]) =>
      element("li", {}, element("strong", {}, name), ` ${amount(row.at_rest_after_s, 2, "s")}`),
    );
    this.#where.append(
      element("ul", { className: "resting", ariaLabel: "Standing still, and after which time" }, ...stand),
    );
  }
}

/** @param {number} robots */
function count(robots) {
  return robots === 1 ? "1 robot" : `${robots} robots`;
}
