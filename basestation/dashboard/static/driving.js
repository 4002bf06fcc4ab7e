/**
 * Driving one robot by hand, by keys or by a thumb-stick.
 *
 * While a hand is on them, a wish is sent ten times a second, and one of zeros when it is taken off. Nothing else is
 * sent. A hand is off when the key or finger is lifted, and when the page loses the focus, is hidden or is left.
 */

/** The behaviour that obeys a hand. */
export const MANUAL = "manual";

/** [ms] */
const PERIOD = 100;

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

  /**
   * @param {import("./connection.js").Connection} connection
   * @param {import("./fleet.js").Fleet} fleet
   * @param {() => void} changed  called when the wish changes.
   */
  constructor(connection, fleet, changed) {
    this.connection = connection;
    this.fleet = fleet;
    this.changed = changed;
    window.addEventListener("keydown", (event) => this.#down(event));
    window.addEventListener("keyup", (event) => this.#up(event));
    window.addEventListener("blur", () => this.letGo());
    window.addEventListener("pagehide", () => this.letGo());
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
    const resting = forwards === 0 && left === 0;
    if (resting) return this.letGo();
    this.#wish([forwards, left]);
  }

  /** The hand is off: zero, at once. */
  letGo() {
    this.#held.clear();
    this.#wish([0, 0]);
  }

  /** @param {KeyboardEvent} event */
  #down(event) {
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
    this.wish = wish;
    this.#send();
    window.clearInterval(this.#timer);
    this.#timer = forwards === 0 && left === 0 ? undefined : window.setInterval(() => this.#send(), PERIOD);
    this.changed();
  }

  /** What the behaviour that obeys a hand allows the robot [m/s, rad/s]. @returns {[number, number]} */
  #limits() {
    const robot = this.fleet.robots.get(this.name);
    const table = this.fleet.hello?.behaviours[MANUAL]?.parameters ?? {};
    const { speed, turning } = robot?.details.parameters ?? {};
    return [speed ?? table.speed?.default ?? 0, turning ?? table.turning?.default ?? 0];
  }

  #send() {
    const [speed, turning] = this.#limits();
    const [forwards, left] = this.wish;
    const sent = this.connection.send({
      order: "drive",
      id: 0,
      name: this.name,
      v: this.pace * forwards * speed,
      omega: this.pace * left * turning,
    });
    if (!sent) {
      // The connection is gone, and with it the hand: when it comes back the key must be pressed anew.
      this.#held.clear();
      this.wish = [0, 0];
      window.clearInterval(this.#timer);
      this.#timer = undefined;
      this.changed();
    }
  }
}
