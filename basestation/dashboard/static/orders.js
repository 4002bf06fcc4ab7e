/** Orders, and what came of each: taken, refused and why, or not answered. */

import { element } from "./dom.js";

/** @typedef {import("./protocol.js").Reply} Reply */

/** Notices that are shown, and for how long [ms]; what went wrong stays longer. */
const MOST_NOTICES = 4;
const SHOWN = { taken: 5000, refused: 15000, unanswered: 15000 };

const OUTCOMES = { taken: "taken", refused: "refused", unanswered: "not answered" };

export class Orders {
  /** @type {import("./connection.js").Connection} */
  #connection;
  /** @type {HTMLElement} */
  #notices;

  /**
   * @param {import("./connection.js").Connection} connection
   * @param {HTMLElement} notices  where outcomes are shown.
   */
  constructor(connection, notices) {
    this.#connection = connection;
    this.#notices = notices;
  }

  /**
   * Give an order, and say what comes of it.
   *
   * @param {string} words  what is ordered, such as "r1 to (1.0, 0.5)".
   * @param {Record<string, unknown>} order
   * @param {{label: string, does: () => void}} [remedy]  what may help when it is refused.
   * @returns {Promise<Reply>}
   */
  async give(words, order, remedy) {
    const reply = await this.#connection.ask(order);
    this.notice(words, reply, reply.outcome === "refused" ? remedy : undefined);
    return reply;
  }

  /**
   * Say what came of an order.
   *
   * @param {string} words
   * @param {{outcome: Reply["outcome"], reason?: string | undefined}} reply
   * @param {{label: string, does: () => void}} [remedy]
   */
  notice(words, { outcome, reason }, remedy) {
    const text = `${words}: ${OUTCOMES[outcome]}`;
    const notice = element("div", { className: `notice ${outcome}` }, element("strong", {}, text));
    if (reason) notice.append(element("span", {}, reason));
    if (remedy !== undefined) {
      const { label, does } = remedy;
      notice.append(
        element("button", {
          type: "button",
          textContent: label,
          onclick: () => {
            notice.remove();
            does();
          },
        }),
      );
    }
    this.#notices.prepend(notice);
    while (this.#notices.children.length > MOST_NOTICES) this.#notices.lastElementChild?.remove();
    setTimeout(() => notice.remove(), SHOWN[outcome]);
  }
}
