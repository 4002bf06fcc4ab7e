/** Stop all, and resume. The button, the space bar and Escape do the same, wherever one is on the page. */

import { element, say } from "./dom.js";
import { amount, figure, listed } from "./words.js";

/** @typedef {import("./protocol.js").Reply} Reply */
/** @typedef {import("./protocol.js").Receipt} Receipt */

export class StopDesk {
  /** A stop was asked for while there was no connection: it is sent as soon as there is one. */
  #owed = false;
  /** Only the newest stop is reported. */
  #asked = 0;
  /** @type {HTMLElement} */
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
   */
  constructor({ button, receipt, resume }, connection, fleet, orders) {
    this.#button = button;
    this.#receipt = receipt;
    this.#resume = resume;
    this.connection = connection;
    this.fleet = fleet;
    this.orders = orders;
    // On the way down: nothing on the page can keep the event from here, and a press counts before it is released.
    button.addEventListener("pointerdown", () => void this.stopAll());
    button.addEventListener("click", (event) => {
      if (event.detail === 0) void this.stopAll(); // by Enter, or by an assistive tool
    });
    for (const kind of /** @type {const} */ (["keydown", "keyup"])) {
      window.addEventListener(kind, (event) => this.#key(event), { capture: true });
    }
  }

  /** The connection is there again. */
  connected() {
    if (this.#owed) void this.stopAll();
  }

  /** Stop every robot, and show what came of it. */
  async stopAll() {
    const asked = ++this.#asked;
    this.#button.classList.add("asked");
    setTimeout(() => this.#button.classList.remove("asked"), 250);
    if (!this.connection.open) {
      this.#owed = true;
      this.#show(
        "bad",
        "Not connected: the stop is sent as soon as the connection is back. Use `muro stop`, or switch the robots off.",
      );
      return;
    }
    this.#owed = false;
    this.#show("waiting", "Stop sent. Waiting for each robot …");
    const reply = await this.connection.ask({ order: "stop", names: [] });
    if (asked === this.#asked) this.#report(reply);
  }

  /** Show whether somebody is stopped, and offer to resume. */
  update() {
    const { stop, maySteer } = this.fleet;
    const stopped = stop.all ? "All robots are stopped" : stop.names.length ? `Stopped: ${listed(stop.names)}` : "";
    this.#resume.hidden = !stopped;
    if (!stopped) {
      this.#resume.replaceChildren();
      return;
    }
    if (this.#resume.dataset.of === `${stopped} ${maySteer}` && this.#resume.childElementCount) return;
    this.#resume.dataset.of = `${stopped} ${maySteer}`;
    this.#offer(stopped, maySteer);
  }

  /**
   * @param {string} stopped
   * @param {boolean} maySteer
   */
  #offer(stopped, maySteer) {
    const words = element("span", {}, stopped);
    if (!maySteer) return this.#resume.replaceChildren(words);
    const ask = element("button", { type: "button", className: "quiet", textContent: "Resume …" });
    ask.onclick = () => {
      const yes = element("button", { type: "button", className: "main", textContent: "Yes, drive again" });
      const no = element("button", { type: "button", className: "quiet", textContent: "No" });
      no.onclick = () => this.#offer(stopped, maySteer);
      yes.onclick = () => {
        this.#offer(stopped, maySteer);
        this.#show("", "");
        void this.orders.give("Resume", { order: "resume", names: [] });
      };
      this.#resume.replaceChildren(element("span", {}, "Is the floor clear?"), yes, no);
      yes.focus();
    };
    this.#resume.replaceChildren(words, ask);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.key !== " " && event.key !== "Escape") return;
    // Also for the release: with it a focused button would be pressed.
    event.preventDefault();
    event.stopPropagation();
    if (event.type === "keydown" && !event.repeat) void this.stopAll();
  }

  /** @param {Reply} reply */
  #report({ outcome, reason, receipt }) {
    if (!receipt) {
      const words =
        outcome === "refused"
          ? "The stop was refused"
          : outcome === "taken"
            ? "The stop was taken"
            : "The stop was not answered";
      this.#show("bad", `${words}${reason ? `: ${reason}` : ""}. Switch the robots off if they drive.`);
      return;
    }
    const rows = Object.entries(receipt.robots);
    const resting = rows.filter(([, { status }]) => status === "stopped");
    const times = resting.map(([, row]) => row.at_rest_after_s ?? 0);
    if (receipt.confirmed) {
      const longest = times.length ? ` within ${figure(Math.max(...times), 2)} s` : "";
      this.#show(
        "good",
        rows.length
          ? `${count(resting.length)} stand${resting.length === 1 ? "s" : ""} still${longest}`
          : "The stop is kept; no robot is known",
      );
    } else {
      this.#show("bad", `${resting.length} of ${count(rows.length)} confirmed. Missing:`);
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
    this.#receipt.append(element("ul", { className: "missing" }, ...lines));
    const stand = resting.map(([name, row]) =>
      element("li", {}, element("strong", {}, name), ` ${amount(row.at_rest_after_s, 2, "s")}`),
    );
    this.#receipt.append(
      element("ul", { className: "resting", ariaLabel: "Standing still, and after which time" }, ...stand),
    );
  }

  /**
   * @param {string} kind
   * @param {string} words
   */
  #show(kind, words) {
    this.#receipt.className = kind;
    this.#receipt.replaceChildren();
    this.#receipt.append(element("p", {}, words));
    say(this.#button.querySelector("small") ?? this.#button, kind === "waiting" ? "sent" : "space or Esc");
  }
}

/** @param {number} robots */
function count(robots) {
  return robots === 1 ? "1 robot" : `${robots} robots`;
}
