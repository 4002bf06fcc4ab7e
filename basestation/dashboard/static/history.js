/** What plots show: a few quantities of every robot over the last minutes. */

/** [s] */
const PERIOD = 0.2;
const KEPT = 180;

/** @typedef {"spacing" | "distance" | "command" | "speed" | "age" | "latency"} Quantity */

/** @type {Quantity[]} */
export const QUANTITIES = ["spacing", "distance", "command", "speed", "age", "latency"];

export class History {
  /** The times of the samples [s since 1970]. @type {number[]} */
  times = [];
  /** Of each robot the samples of each quantity. @type {Map<string, Record<Quantity, (number | null)[]>>} */
  #samples = new Map();

  /**
   * Take the newest state of the fleet, if it is time to.
   *
   * @param {import("./fleet.js").Fleet} fleet
   */
  take(fleet) {
    const t = fleet.state?.t ?? 0;
    const last = this.times.at(-1) ?? -Infinity;
    if (t < last)
      this.#clear(); // the server's clock was set back
    else if (t - last < PERIOD - 0.01) return;
    this.times.push(t);
    for (const name of fleet.robots.keys()) if (!this.#samples.has(name)) this.#samples.set(name, this.#empty());
    const even = (2 * Math.PI) / Math.max(1, Object.keys(fleet.gaps).length);
    for (const [name, samples] of this.#samples) {
      const now = measure(fleet, name, even);
      for (const quantity of QUANTITIES) samples[quantity].push(now[quantity]);
    }
    const old = this.times.findIndex((time) => time >= t - KEPT);
    // Not one by one: a shift of all arrays at every sample would be most of the work.
    if (old > 60 / PERIOD) this.#drop(old);
  }

  /**
   * @param {string} name  of a robot.
   * @param {Quantity} quantity
   * @returns {(number | null)[]} as long as `times`.
   */
  of(name, quantity) {
    return this.#samples.get(name)?.[quantity] ?? this.times.map(() => null);
  }

  /** All of it as it is now; what comes later does not change it. @returns {History} */
  copy() {
    const made = new History();
    made.times = [...this.times];
    made.#samples = structuredClone(this.#samples);
    return made;
  }

  /** @returns {Record<Quantity, (number | null)[]>} */
  #empty() {
    /** @type {(number | null)[]} */
    const nothing = new Array(this.times.length - 1).fill(null);
    const made = QUANTITIES.map((quantity) => [quantity, [...nothing]]);
    return /** @type {Record<Quantity, (number | null)[]>} */ (Object.fromEntries(made));
  }

  #clear() {
    this.#drop(this.times.length);
  }

  /** @param {number} count */
  #drop(count) {
    this.times.splice(0, count);
    for (const samples of this.#samples.values()) {
      for (const quantity of QUANTITIES) samples[quantity].splice(0, count);
    }
  }
}

/**
 * @param {import("./fleet.js").Fleet} fleet
 * @param {string} name
 * @param {number} even  the gap of robots that are spread evenly [rad].
 * @returns {Record<Quantity, number | null>} degrees, metres, m/s and milliseconds.
 */
function measure(fleet, name, even) {
  const robot = fleet.robots.get(name);
  const { circle } = fleet;
  const seen = robot !== undefined && robot.placed && robot.condition !== "lost";
  const gap = robot && circle && massOf(robot, circle, fleet.gaps[name]);
  const { latency = null, pose_age = null } = robot?.details ?? {};
  return {
    spacing: gap === undefined || gap === null ? null : ((gap - even) * 180) / Math.PI,
    distance: seen && circle !== null ? Math.hypot(robot.x - circle.x, robot.y - circle.y) - circle.radius : null,
    command: robot?.command[0] ?? null,
    speed: seen ? robot.v : null,
    age: pose_age === null ? null : 1000 * pose_age,
    latency: latency === null ? null : 1000 * latency,
  };
}

/**
 * A gap as it counts: where the circle is more important, robots are to be closer to each other.
 *
 * @param {import("./fleet.js").Robot} robot  behind the gap.
 * @param {import("./protocol.js").Circle} circle
 * @param {number | undefined} gap  [rad]
 * @returns {number | undefined} the importance (its mean is 1) summed over the gap [rad].
 */
function massOf(robot, circle, gap) {
  const { importance } = circle;
  if (gap === undefined || !importance) return gap;
  const from = Math.atan2(robot.y - circle.y, robot.x - circle.x);
  const steps = importance.length;
  const step = ((circle.clockwise ? -1 : 1) * gap) / steps;
  let mass = 0;
  for (let k = 0; k < steps; k++) {
    const at = ((from + (k + 0.5) * step) / (2 * Math.PI)) * steps;
    const index = Math.floor(at);
    const [low, high] = [index, index + 1].map((i) => importance[((i % steps) + steps) % steps] ?? 1);
    mass += /** @type {number} */ (low) + (at - index) * /** @type {number} */ (high - /** @type {number} */ (low));
  }
  return (mass / steps) * gap;
}
