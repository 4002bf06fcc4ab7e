/** The arena on its canvas: what is drawn, in which order, and when. */

import { drawCameras, drawCircle, drawFloor, drawGaps, drawWalls } from "./floor_layer.js";
import { drawGoal, drawPlans } from "./plan_layer.js";
import { drawRobots } from "./robot_layer.js";
import { Trails } from "./trails.js";
import { View } from "./view.js";

/** @typedef {import("./protocol.js").Circle} Circle */

/** So many of the newest drawing times are kept. */
const TIMES = 600;

export class Arena {
  view = new View();
  /** The robot that is looked at and steered; empty for none. */
  selected = "";
  /** A goal that is being set, with a heading if there is one. @type {[number, number, number | null] | null} */
  goal = null;
  /** The circle while it is moved by hand, and its handles. @type {Circle | null} */
  circle = null;
  /** How long the newest drawings took [ms]. @type {number[]} */
  times = [];

  #trails = new Trails();
  #waiting = false;
  /** @type {CanvasRenderingContext2D} */
  #context;

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./fleet.js").Fleet} fleet
   * @param {import("./palette.js").Palette} palette
   * @param {import("./pictures.js").Pictures} pictures
   */
  constructor(canvas, fleet, palette, pictures) {
    this.canvas = canvas;
    this.fleet = fleet;
    this.palette = palette;
    this.pictures = pictures;
    const context = canvas.getContext("2d");
    if (context === null) throw new Error("this browser has no canvas");
    this.#context = context;
    new ResizeObserver(() => this.#resize()).observe(canvas);
    this.#resize();
  }

  /** Take the newest state of the fleet. @param {number} now  [s] */
  take(now) {
    this.#trails.take(this.fleet.robots.values(), now);
    this.pictures.remember(this.fleet.robots.values(), now);
    this.redraw();
  }

  /** Draw, as soon as the browser shows something. */
  redraw() {
    if (this.#waiting) return;
    this.#waiting = true;
    requestAnimationFrame(() => {
      this.#waiting = false;
      const began = performance.now();
      this.#draw();
      this.times.push(performance.now() - began);
      if (this.times.length > TIMES) this.times.shift();
    });
  }

  /**
   * Where a robot is on the canvas [px of CSS]; null when it has no place.
   *
   * @param {string} name
   * @returns {[number, number] | null}
   */
  screenOf(name) {
    const robot = this.fleet.robots.get(name);
    return robot?.placed ? [this.view.px(robot.x), this.view.py(robot.y)] : null;
  }

  #resize() {
    const { clientWidth, clientHeight } = this.canvas;
    const sharp = Math.min(window.devicePixelRatio || 1, 3);
    this.canvas.width = Math.max(1, Math.round(clientWidth * sharp));
    this.canvas.height = Math.max(1, Math.round(clientHeight * sharp));
    this.view.resize(Math.max(1, clientWidth), Math.max(1, clientHeight));
    this.#waiting = false;
    this.#draw(); // at once: a canvas that has changed its size is empty
  }

  #draw() {
    const { view, palette, fleet } = this;
    const context = this.#context;
    const sharp = this.canvas.width / view.width;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    context.setTransform(sharp, 0, 0, sharp, 0, 0);
    const hello = fleet.hello;
    if (hello === null) return;
    const followed = fleet.robots.get(view.followed);
    if (followed?.placed) view.centre(followed.x, followed.y);
    const robots = [...fleet.robots.values()];
    const covered = this.pictures.on && this.pictures.draw(context, view, fleet.state?.t ?? 0);
    drawFloor(context, view, palette, hello.arena, covered);
    drawCameras(context, view, palette, hello.cameras);
    drawWalls(context, view, palette, hello.walls);
    drawPlans(context, view, palette, robots, this.selected);
    const circle = this.circle ?? fleet.circle;
    if (circle !== null && (this.circle !== null || this.#circleMatters(robots))) {
      drawCircle(context, view, palette, circle);
      if (this.circle === null) drawGaps(context, view, palette, fleet, circle);
      else this.#drawHandles(circle);
    }
    this.#trails.draw(context, view, palette, robots, this.selected);
    if (covered) this.pictures.drawRings(context, view);
    drawRobots(context, view, palette, robots, this.selected, covered);
    if (this.goal !== null) drawGoal(context, view, palette, this.goal, true);
  }

  /** Whether anybody follows the circle. @param {import("./fleet.js").Robot[]} robots */
  #circleMatters(robots) {
    const behaviours = this.fleet.hello?.behaviours ?? {};
    return robots.some(
      ({ details: { behaviour } }) => behaviour && (behaviours[behaviour]?.needs ?? ["circle"]).includes("circle"),
    );
  }

  /** What a hand can take hold of. @param {Circle} circle */
  #drawHandles({ x, y, radius }) {
    const context = this.#context;
    context.fillStyle = this.palette.surface;
    context.strokeStyle = this.palette.accent;
    context.lineWidth = 2.5;
    for (const [hx, hy] of handlesOf({ x, y, radius })) {
      context.beginPath();
      context.arc(this.view.px(hx), this.view.py(hy), 9, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    }
  }
}

/**
 * The handles of a circle: its middle, and a point of it.
 *
 * @param {{x: number, y: number, radius: number}} circle
 * @returns {[[number, number], [number, number]]}
 */
export function handlesOf({ x, y, radius }) {
  return [
    [x, y],
    [x + radius * Math.SQRT1_2, y - radius * Math.SQRT1_2],
  ];
}
