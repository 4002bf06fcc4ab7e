/** What is to be known of the connection: live, silent, or lost and when it is tried again. */

import { say } from "./dom.js";
import { figure } from "./words.js";

/** Twenty states a second come; after so long without one what is shown is old, and looks it [ms]. */
const OLD = 600;

export class Link {
  /**
   * @param {{word: HTMLElement, veil: HTMLElement, body: HTMLElement}} parts
   * @param {import("./connection.js").Connection} connection
   */
  constructor({ word, veil, body }, connection) {
    this.word = word;
    this.veil = veil;
    this.body = body;
    this.connection = connection;
  }

  /** @returns {boolean} whether what is shown is what is. */
  update() {
    const { open, heard, retryAt, refusal } = this.connection;
    const now = performance.now();
    const silent = (now - heard) / 1000;
    const live = open && now - heard < OLD;
    const known = Number.isFinite(heard);
    const age = `${figure(silent, silent < 10 ? 1 : 0)} s`;
    let [state, words, veil] = ["live", "Live", ""];
    if (open && !live) {
      [state, words] = ["old", `Old: ${age}`];
      veil = `Nothing has come for ${age}. This is what was seen last.`;
    } else if (!open && refusal) {
      [state, words, veil] = ["lost", "Not admitted", `The base station does not let this page in: ${refusal}.`];
    } else if (!open) {
      const wait = Math.max(0, (retryAt - now) / 1000);
      [state, words] = ["lost", known ? "Disconnected" : "Connecting"];
      const again = wait > 0.3 ? `Trying again in ${figure(wait, 0)} s.` : "Trying again now.";
      veil = known
        ? `No connection to the base station for ${age}. ${again} This is what was seen last.`
        : "Connecting to the base station …";
    }
    this.body.dataset.link = state;
    say(this.word, words);
    say(this.veil, veil);
    this.veil.hidden = !veil;
    return live;
  }
}
