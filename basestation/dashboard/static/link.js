/** What is to be known of the connection: live, silent, or lost and when it is tried again. */

import { say } from "./dom.js";
import { amount, figure } from "./words.js";

/** Twenty states a second come; after so long without one what is shown is old, and looks it [ms]. */
const OLD = 600;

export class Link {
  #parts;
  #connection;

  /**
   * What is read aloud whenever it changes has no figures: an age would be read five times a second.
   *
   * @param {{words: HTMLElement, age: HTMLElement, veil: HTMLElement, why: HTMLElement, more: HTMLElement}} parts
   *   `words` and `why` are read aloud, `age` and `more` stand beside them; `veil` lies over the floor.
   * @param {import("./connection.js").Connection} connection
   */
  constructor(parts, connection) {
    this.#parts = parts;
    this.#connection = connection;
  }

  /**
   * @param {boolean} reached  whether the base station hears anything of the fleet.
   * @returns {boolean} whether what is shown is what is.
   */
  update(reached) {
    const { open, heard, retryAt, refusal } = this.#connection;
    const now = performance.now();
    const silent = (now - heard) / 1000;
    const comes = open && now - heard < OLD;
    const live = comes && reached;
    const known = Number.isFinite(heard);
    const age = amount(silent, silent < 10 ? 1 : 0, "s");
    let [state, words, wordsAge, why, more] = ["live", "Live", "", "", ""];
    if (comes && !reached) {
      [state, words] = ["old", "Old"];
      why =
        "Nothing comes from the fleet: its router is gone, or the base station is frozen. This is what was seen last.";
    } else if (open && !live) {
      [state, words, wordsAge] = ["old", "Old", age];
      [why, more] = ["Nothing comes from the base station. This is what was seen last.", `Last heard ${age} ago.`];
    } else if (!open && refusal) {
      [state, words, why] = ["lost", "Not admitted", `The base station does not let this page in: ${refusal}.`];
    } else if (!open) {
      const wait = Math.max(0, (retryAt - now) / 1000);
      const again = wait > 0.3 ? `Trying again in ${figure(wait, 0)} s.` : "Trying again now.";
      [state, words] = ["lost", known ? "Disconnected" : "Connecting"];
      why = known
        ? "No connection to the base station. This is what was seen last."
        : "Connecting to the base station …";
      more = known ? `Last heard ${age} ago. ${again}` : "";
    }
    document.body.dataset.link = state;
    const parts = this.#parts;
    say(parts.words, words);
    say(parts.age, wordsAge);
    say(parts.why, why);
    say(parts.more, more);
    parts.veil.hidden = !why;
    return live;
  }
}
