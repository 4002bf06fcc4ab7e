/** What a mouse or fingers do on the arena: choose a robot, set a goal, move the circle, look elsewhere. */

import { handlesOf } from "./arena.js";

/** @typedef {import("./protocol.js").Circle} Circle */

/**
 * @typedef {object} Hands  What is done about it.
 * @property {(name: string) => void} choose  a robot.
 * @property {() => boolean} maySetGoal  whether a click on the floor is a goal.
 * @property {(x: number, y: number, theta: number | null) => void} setGoal
 * @property {(circle: Circle) => void} moveCircle
 */

/** A finger is not exact [px]. */
const SLACK = 8;

/** From here on a drag says a heading [px]. */
const HEADING = 16;

/** @typedef {"robot" | "goal" | "middle" | "rim" | "pan" | "pinch"} Act */

export class ArenaPointer {
  /** @type {Map<number, {x: number, y: number}>} */
  #fingers = new Map();
  /** @type {Act | null} */
  #act = null;
  #robot = "";
  /** Where the first finger came down [px]. */
  #start = { x: 0, y: 0 };
  /** The same on the floor [m, world]: the view may move meanwhile. @type {[number, number]} */
  #place = [0, 0];

  /**
   * @param {import("./arena.js").Arena} arena
   * @param {Hands} hands
   */
  constructor(arena, hands) {
    this.arena = arena;
    this.hands = hands;
    const { canvas } = arena;
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.#up(event));
    canvas.addEventListener("pointercancel", (event) => this.#forget(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        arena.view.zoom(Math.exp(-0.0015 * event.deltaY), event.offsetX, event.offsetY);
        arena.redraw();
      },
      { passive: false },
    );
  }

  /** @param {PointerEvent} event */
  #down(event) {
    const at = { x: event.offsetX, y: event.offsetY };
    this.arena.canvas.setPointerCapture(event.pointerId);
    this.#fingers.set(event.pointerId, at);
    if (this.#fingers.size > 1) {
      this.arena.goal = null;
      this.#act = "pinch";
      this.arena.redraw();
      return;
    }
    this.#start = at;
    this.#place = this.arena.view.toWorld(at.x, at.y);
    this.#act = event.button === 0 ? this.#actAt(at) : "pan";
    if (this.#act === "goal") this.#aim(at);
  }

  /**
   * What a press here begins.
   *
   * @param {{x: number, y: number}} at
   * @returns {Act}
   */
  #actAt(at) {
    if (this.arena.circle !== null) {
      const [middle, rim] = handlesOf(this.arena.circle).map(([x, y]) => this.#distance(at, x, y));
      if (/** @type {number} */ (middle) < 22) return "middle";
      if (/** @type {number} */ (rim) < 22) return "rim";
    }
    this.#robot = this.#robotAt(at);
    if (this.#robot) return "robot";
    return this.hands.maySetGoal() && this.#isInside(at) ? "goal" : "pan";
  }

  /** @param {PointerEvent} event */
  #move(event) {
    const before = this.#fingers.get(event.pointerId);
    if (before === undefined) {
      this.arena.canvas.classList.toggle("on-robot", this.#robotAt({ x: event.offsetX, y: event.offsetY }) !== "");
      return;
    }
    const at = { x: event.offsetX, y: event.offsetY };
    if (this.#act === "pinch") this.#pinch(event.pointerId, before, at);
    this.#fingers.set(event.pointerId, at);
    const far = Math.hypot(at.x - this.#start.x, at.y - this.#start.y) > SLACK;
    if (this.#act === "robot" && far) this.#act = "pan";
    if (this.#act === "pan") this.arena.view.pan(at.x - before.x, at.y - before.y);
    if (this.#act === "goal") this.#aim(at);
    if (this.#act === "middle" || this.#act === "rim") this.#dragCircle(at);
    if (this.#act !== "robot") this.arena.redraw();
  }

  /** @param {PointerEvent} event */
  #up(event) {
    if (!this.#fingers.has(event.pointerId)) return;
    const act = this.#act;
    if (act === "robot") this.hands.choose(this.#robot);
    if (act === "goal" && this.arena.goal !== null) this.hands.setGoal(...this.arena.goal);
    if ((act === "middle" || act === "rim") && this.arena.circle !== null) this.hands.moveCircle(this.arena.circle);
    this.#forget(event.pointerId);
  }

  /** @param {number} finger */
  #forget(finger) {
    this.#fingers.delete(finger);
    if (this.#fingers.size === 0) this.#act = null;
    this.arena.goal = null;
    this.arena.redraw();
  }

  /** @param {{x: number, y: number}} at */
  #aim(at) {
    const { x, y } = this.#start;
    const heading = Math.hypot(at.x - x, at.y - y) > HEADING ? Math.atan2(y - at.y, at.x - x) : null;
    this.arena.goal = [...this.#place, heading];
    this.arena.redraw();
  }

  /** @param {{x: number, y: number}} at */
  #dragCircle(at) {
    const { circle, view } = this.arena;
    if (circle === null) return;
    const [x, y] = view.toWorld(at.x, at.y);
    this.arena.circle =
      this.#act === "middle"
        ? { ...circle, x, y }
        : { ...circle, radius: Math.max(0.05, Math.hypot(x - circle.x, y - circle.y)) };
  }

  /**
   * @param {number} finger
   * @param {{x: number, y: number}} before
   * @param {{x: number, y: number}} at
   */
  #pinch(finger, before, at) {
    const other = [...this.#fingers].find(([id]) => id !== finger)?.[1];
    if (other === undefined) return;
    const was = Math.hypot(before.x - other.x, before.y - other.y);
    const is = Math.hypot(at.x - other.x, at.y - other.y);
    this.arena.view.pan((at.x - before.x) / 2, (at.y - before.y) / 2);
    if (was > 10 && is > 10) this.arena.view.zoom(is / was, (at.x + other.x) / 2, (at.y + other.y) / 2);
  }

  /**
   * The robot at a pixel; empty for none.
   *
   * @param {{x: number, y: number}} at
   * @returns {string}
   */
  #robotAt(at) {
    let [found, least] = ["", Infinity];
    for (const robot of this.arena.fleet.robots.values()) {
      if (!robot.placed) continue;
      const away = this.#distance(at, robot.x, robot.y);
      const reach = Math.max(14, robot.facts.radius * this.arena.view.scale) + 4;
      if (away < reach && away < least) [found, least] = [robot.name, away];
    }
    return found;
  }

  /**
   * @param {{x: number, y: number}} at  [px]
   * @param {number} x  [m, world]
   * @param {number} y
   */
  #distance(at, x, y) {
    return Math.hypot(at.x - this.arena.view.px(x), at.y - this.arena.view.py(y));
  }

  /** @param {{x: number, y: number}} at */
  #isInside(at) {
    const [left, bottom, right, top] = this.arena.fleet.hello?.arena ?? [0, 0, 0, 0];
    const [x, y] = this.arena.view.toWorld(at.x, at.y);
    return x >= left && x <= right && y >= bottom && y <= top;
  }
}
