/** The connection to the base station: one WebSocket, MessagePack both ways, which comes back by itself. */

import { messagePack } from "./vendor.js";

/** @typedef {import("./protocol.js").Message} Message */
/** @typedef {import("./protocol.js").Reply} Reply */

/** An order that is not answered by then is reported as such [ms]: later than the base station's own limits, of which
 * the longest is that for what is broken by hand, 8 s. */
const ANSWER_TIMEOUT = 10000;

/** Twenty states a second come; after this long without one the link is dead, whatever the browser thinks [ms]. */
const SILENCE = 4000;

/** An attempt to connect that has not led to a `hello` by then is given up [ms]; a browser would wait for minutes. */
const CONNECT_TIMEOUT = 3000;

/** Waits between attempts to connect [ms]. */
const RETRIES = [250, 500, 1000, 2000];

/** The code with which a connection is closed that may not read. */
const REFUSED = 4401;

export class Connection {
  /** Whether it is open, and the base station has let us in: it says `hello` then. */
  open = false;
  /** How many messages have been sent since the page was loaded. */
  sent = 0;
  /** When the last message came [ms, performance.now()]; minus infinity before the first. */
  heard = -Infinity;
  /** Why the base station does not want us; empty when it was not asked or did not say. */
  refusal = "";
  /** When the next attempt to connect is made [ms, performance.now()]. */
  retryAt = 0;

  /** @type {WebSocket | null} */
  #socket = null;
  #id = 0;
  #attempt = 0;
  /** @type {Map<number, (reply: Reply) => void>} */
  #waiting = new Map();
  /** @type {string} */
  #address;
  /** @type {string[]} */
  #protocols;
  /** @type {(message: Message) => void} */
  #received;
  /** @type {(open: boolean) => void} */
  #changed;

  /**
   * @param {string} address  where to connect to.
   * @param {string} token  that says who may do what; empty for none.
   * @param {(message: Message) => void} received  called with every message but the replies that somebody waits for.
   * @param {(open: boolean) => void} changed  called when the connection opens or closes.
   */
  constructor(address, token, received, changed) {
    this.#address = address;
    this.#protocols = token ? ["muro", `token.${token}`] : ["muro"];
    this.#received = received;
    this.#changed = changed;
    this.#connect();
    setInterval(() => {
      if (this.open && performance.now() - this.heard > SILENCE) this.#lost();
    }, 500);
  }

  /** How much that was sent is still in this machine [bytes]. */
  get buffered() {
    return this.#socket?.bufferedAmount ?? 0;
  }

  /**
   * Send an order that nobody waits for.
   *
   * @param {Record<string, unknown>} order
   * @returns {boolean} whether it was sent.
   */
  send(order) {
    if (!this.open || this.#socket === null || messagePack === null) return false;
    this.#socket.send(/** @type {Uint8Array<ArrayBuffer>} */ (messagePack.encode(order)));
    this.sent += 1;
    return true;
  }

  /**
   * Give an order, and wait for what comes of it. It never fails: no answer is an outcome too.
   *
   * @param {Record<string, unknown>} order
   * @returns {Promise<Reply>}
   */
  ask(order) {
    const id = ++this.#id;
    return new Promise((resolve) => {
      /** @param {string} reason */
      const unanswered = (reason) => resolve({ kind: "reply", id, outcome: "unanswered", reason });
      if (!this.send({ ...order, id })) return unanswered("not connected");
      const timer = setTimeout(() => {
        this.#waiting.delete(id);
        unanswered(`nothing within ${ANSWER_TIMEOUT / 1000} s`);
      }, ANSWER_TIMEOUT);
      this.#waiting.set(id, (reply) => {
        clearTimeout(timer);
        this.#waiting.delete(id);
        resolve(reply);
      });
    });
  }

  #connect() {
    const socket = new WebSocket(this.#address, this.#protocols);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => {
      this.heard = performance.now();
      if (messagePack === null) return;
      const message = /** @type {Message} */ (messagePack.decode(new Uint8Array(data)));
      if (message.kind === "hello" && !this.open) this.#admitted();
      const waiting = message.kind === "reply" ? this.#waiting.get(message.id) : undefined;
      if (message.kind === "reply" && waiting !== undefined) waiting(message);
      else this.#received(message);
    };
    socket.onclose = ({ code, reason }) => {
      this.refusal = code === REFUSED ? reason || "this address needs a token" : "";
      this.#lost();
    };
    this.#socket = socket;
    setTimeout(() => {
      if (this.#socket === socket && !this.open) this.#lost();
    }, CONNECT_TIMEOUT);
  }

  #admitted() {
    this.open = true;
    this.refusal = "";
    this.#attempt = 0;
    this.#changed(true);
  }

  #lost() {
    const socket = this.#socket;
    if (socket === null) return;
    this.#socket = null;
    socket.onmessage = socket.onclose = null;
    socket.close();
    const wasOpen = this.open;
    this.open = false;
    for (const [id, answer] of [...this.#waiting]) {
      answer({ kind: "reply", id, outcome: "unanswered", reason: "the connection was lost" });
    }
    const wait = RETRIES[Math.min(this.#attempt, RETRIES.length - 1)] ?? 1000;
    this.#attempt += 1;
    this.retryAt = performance.now() + wait;
    setTimeout(() => this.#connect(), wait);
    if (wasOpen) this.#changed(false);
  }
}
