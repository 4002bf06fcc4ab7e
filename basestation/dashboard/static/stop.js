/** Stop all, and resume. The button, the space bar and Escape do the same, wherever one is on the page. */

import { element, say } from "./dom.js";
import { Receipt } from "./receipt.js";
import { ResumeButton } from "./resume.js";
import { listed } from "./words.js";

export class StopDesk {
  /** Stops that no receipt has come for, by their robots: they are sent again when there is a new connection.
   * @type {Map<string, {names: string[], receipt: Receipt}>} */
  #owed = new Map();
  /** Of each kind of stop only the newest is reported. @type {Map<string, number>} */
  #asked = new Map();
  #receipt;
  /** @type {HTMLElement} */
  #resume;
  /** @type {HTMLElement} */
  #button;

  /**
   * @param {{button: HTMLElement, receipt: HTMLElement, resume: HTMLElement}} parts
   * @param {import("./connection.js").Connection} connection
   * @param {import("./fleet.js").Fleet} fleet
   * @param {import("./orders.js").Orders} orders
   * @param {() => void} pressed  called with every stop.
   */
  constructor({ button, receipt, resume }, connection, fleet, orders, pressed) {
    this.#button = button;
    this.#receipt = new Receipt(receipt);
    this.#resume = resume;
    this.connection = connection;
    this.fleet = fleet;
    this.orders = orders;
    this.pressed = pressed;
    // On the way down: nothing on the page can keep the event from here, and a press counts before it is released.
    button.addEventListener("pointerdown", () => this.stopAll());
    button.addEventListener("click", (event) => {
      if (event.detail === 0) this.stopAll(); // by Enter, or by an assistive tool
    });
    for (const kind of /** @type {const} */ (["keydown", "keyup"])) {
      window.addEventListener(kind, (event) => this.#key(event), { capture: true });
    }
  }

  /** The connection is there again. */
  connected() {
    for (const { names, receipt } of [...this.#owed.values()]) void this.stop(names, receipt);
  }

  /** Stop every robot, and show what came of it. */
  stopAll() {
    void this.stop([], this.#receipt);
    this.#button.classList.add("asked");
    setTimeout(() => this.#button.classList.remove("asked"), 250);
  }

  /**
   * Stop robots, and show what came of it.
   *
   * @param {string[]} names  none for all.
   * @param {Receipt} receipt  where that is shown.
   */
  async stop(names, receipt) {
    const key = names.join(" ");
    const asked = (this.#asked.get(key) ?? 0) + 1;
    this.#asked.set(key, asked);
    this.#owed.set(key, { names, receipt });
    const answer = this.connection.ask({ order: "stop", names }); // before anything that might fail
    this.pressed();
    if (!this.connection.open) {
      receipt.show(
        "bad",
        "Not connected: the stop is sent as soon as the connection is back. Use `muro stop`, or switch the robots off.",
      );
      return;
    }
    receipt.show("waiting", "Stop sent. Waiting for each robot …");
    if (!names.length) this.#label("sent");
    const reply = await answer;
    if (asked !== this.#asked.get(key)) return;
    if (!names.length) this.#label("space or Esc");
    if (reply.receipt) this.#settle(names);
    receipt.report(reply, this.#owed.has(key), names.length ? names : [...this.fleet.robots.keys()]);
  }

  /** A stop of these robots, or of all, is owed no longer. @param {string[]} names */
  #settle(names) {
    if (names.length) this.#owed.delete(names.join(" "));
    else this.#owed.clear();
  }

  /** Show whether somebody is stopped, and offer to resume. */
  update() {
    const { stop, maySteer } = this.fleet;
    const stopped = stop.all ? "All robots are stopped" : stop.names.length ? `Stopped: ${listed(stop.names)}` : "";
    this.#resume.hidden = !stopped;
    const shown = stopped && `${stopped} ${maySteer}`;
    if (shown === (this.#resume.dataset.of ?? "")) return;
    this.#resume.dataset.of = shown;
    this.#resume.replaceChildren();
    if (!stopped) return;
    this.#resume.append(element("span", {}, stopped));
    if (maySteer) this.#resume.append(this.resumeButton("", []).element);
  }

  /**
   * A button that resumes robots.
   *
   * @param {string} who  in words; empty for all.
   * @param {string[]} names  none for all.
   */
  resumeButton(who, names) {
    return new ResumeButton(this.fleet, this.orders, who, names, () => {
      this.#settle(names); // whoever resumes wants no stop of before any more
      if (!names.length) this.#receipt.show("", "");
    });
  }

  /** @param {string} words */
  #label(words) {
    say(this.#button.querySelector("small") ?? this.#button, words);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.key !== " " && event.key !== "Escape") return;
    // Also for the release: with it a focused button would be pressed.
    event.preventDefault();
    event.stopPropagation();
    if (event.type === "keydown" && !event.repeat) this.stopAll();
  }
}
