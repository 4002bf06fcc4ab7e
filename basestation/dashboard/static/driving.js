/**
 * Driving one robot by hand, by keys or by a thumb-stick.
 *
 * While a hand is on them, a wish is sent ten times a second, and one of zeros when it is taken off. Nothing else is
 * sent. A hand is off when the key or finger is lifted, and when the page loses the focus, is hidden or is left; also
 * where the browser may not say that a key was lifted, and when the robot is not seen as it is now.
 */

/** What a behaviour needs that obeys a hand. */
export const HAND = "drive";

/** [ms] */
const PERIOD = 100;

/** Nobody drives by what was seen longer ago [ms]. */
const OLD = 300;

/** A wish that waits longer than this to be sent would come too late [ms]. */
const STUCK = 300;

/** With these held the system may take the release of another key for itself: macOS does so with Cmd. */
const MODIFIERS = new Set(["Meta", "Control", "Alt", "AltGraph", "OS"]);

/** @type {Record<string, [number, number]>} how much forwards, and to the left. */
const KEYS = {
  ArrowUp: [1, 0],
  ArrowDown: [-1, 0],
  ArrowLeft: [0, 1],
  ArrowRight: [0, -1],
  KeyW: [1, 0],
  KeyS: [-1, 0],
  KeyA: [0, 1],
  KeyD: [0, -1],
};

export class Driving {
  /** The robot that is driven; empty for none. */
  name = "";
  /** How fast, as a fraction of what the robot can do. */
  pace = 0.5;
  /** What the hand wants now: forwards and to the left, each in [-1, 1]. @type {[number, number]} */
  wish = [0, 0];

  /** @type {Set<string>} */
  #held = new Set();
  /** @type {number | undefined} */
  #timer;
  /** When all that was sent had last left the page [ms, performance.now()]. */
  #flowed = 0;

  /**
   * @param {import("./connection.js").Connection} connection
   * @param {import("./fleet.js").Fleet} fleet
   * @param {{changed: () => void, released: () => void}} heard  called when the wish changes, and when the hand must
   *   come anew although it may still be there.
   */
  constructor(connection, fleet, { changed, released }) {
    this.connection = connection;
    this.fleet = fleet;
    this.changed = changed;
    this.released = released;
    window.addEventListener("keydown", (event) => this.#down(event));
    window.addEventListener("keyup", (event) => this.#up(event));
    window.addEventListener("blur", () => this.letGo());
    window.addEventListener("pagehide", () => this.letGo());
    window.addEventListener("contextmenu", () => this.letGo()); // it takes the keys
    for (const kind of /** @type {const} */ (["keydown", "keyup"])) {
      window.addEventListener(kind, ({ key }) => MODIFIERS.has(key) && this.letGo(), { capture: true });
    }
    document.addEventListener("visibilitychange", () => document.hidden && this.letGo());
  }

  /**
   * Take a robot by the hand, or none.
   *
   * @param {string} name
   */
  take(name) {
    this.letGo();
    this.name = name;
  }

  /**
   * What the thumb-stick says.
   *
   * @param {number} forwards  in [-1, 1].
   * @param {number} left
   */
  steer(forwards, left) {
    if (!this.name) return;
    this.#wish([forwards, left]);
  }

  /** The hand is off: zero, at once. A key or finger that is still there must come anew. */
  letGo() {
    this.#held.clear();
    this.#wish([0, 0]);
    this.released();
  }

  /** @param {KeyboardEvent} event */
  #down(event) {
    // A key that drives repeats while it is held; a field that got the focus meanwhile would take that for an entry.
    if (this.#held.has(event.code)) return event.preventDefault();
    if (!(event.code in KEYS) || !this.name || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target instanceof HTMLElement && event.target.closest("input, select, textarea, [role=tablist]")) return;
    event.preventDefault();
    if (event.repeat) return;
    this.#held.add(event.code);
    this.#keys();
  }

  /** @param {KeyboardEvent} event */
  #up(event) {
    if (this.#held.delete(event.code)) this.#keys();
  }

  #keys() {
    let [forwards, left] = [0, 0];
    for (const code of this.#held) {
      const [ahead, aside] = /** @type {[number, number]} */ (KEYS[code]);
      forwards += ahead;
      left += aside;
    }
    this.#wish([Math.sign(forwards), Math.sign(left)]);
  }

  /** @param {[number, number]} wish */
  #wish(wish) {
    const [forwards, left] = wish;
    if (forwards === this.wish[0] && left === this.wish[1]) return;
    const begins = this.wish[0] === 0 && this.wish[1] === 0;
    this.wish = wish;
    window.clearInterval(this.#timer);
    if (begins) this.#flowed = performance.now();
    this.#timer = forwards === 0 && left === 0 ? undefined : window.setInterval(() => this.#send(), PERIOD);
    this.#send();
    this.changed();
  }

  /** What the behaviour that obeys a hand allows the robot [m/s, rad/s]. @returns {[number, number]} */
  #limits() {
    const { behaviour = null, parameters = {} } = this.fleet.robots.get(this.name)?.details ?? {};
    const table = this.fleet.hello?.behaviours[behaviour ?? ""]?.parameters ?? {};
    const { speed, turning } = parameters;
    return [speed ?? table.speed?.default ?? 0, turning ?? table.turning?.default ?? 0];
  }

  #send() {
    const { connection, fleet } = this;
    const [forwards, left] = this.wish;
    const now = performance.now();
    if (connection.buffered === 0) this.#flowed = now;
    if ((forwards !== 0 || left !== 0) && (now - connection.heard > OLD || now - this.#flowed > STUCK)) {
      return this.letGo();
    }
    const [speed, turning] = this.#limits();
    const sent = connection.send({
      order: "drive",
      id: 0,
      name: this.name,
      v: this.pace * forwards * speed,
      omega: this.pace * left * turning,
      t: fleet.state?.t ?? 0,
    });
    if (sent) return;
    // The connection is gone, and with it the hand.
    this.wish = [0, 0];
    window.clearInterval(this.#timer);
    this.#timer = undefined;
    this.changed();
    this.letGo();
  }
}
