/** The way that each robot came, of the last seconds. */

/** How long a trail is kept [s]. */
const KEPT = 12;

/** A robot that has not moved so far leaves no new mark [m]. */
const STEP = 0.02;

/** In how many pieces a trail fades. */
const PIECES = 3;

/** @typedef {{x: number, y: number, t: number}} Mark */

export class Trails {
  /** @type {Map<string, Mark[]>} */
  #marks = new Map();

  /**
   * Take where the robots are.
   *
   * @param {Iterable<import("./fleet.js").Robot>} robots
   * @param {number} now  [s]
   */
  take(robots, now) {
    for (const robot of robots) {
      let marks = this.#marks.get(robot.name);
      if (marks === undefined) this.#marks.set(robot.name, (marks = []));
      while (marks[0] !== undefined && marks[0].t < now - KEPT) marks.shift();
      if (!robot.placed || robot.condition === "lost") continue;
      const last = marks.at(-1);
      if (last === undefined || Math.hypot(robot.x - last.x, robot.y - last.y) >= STEP) {
        marks.push({ x: robot.x, y: robot.y, t: now });
      }
    }
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {import("./view.js").View} view
   * @param {import("./palette.js").Palette} palette
   * @param {Iterable<import("./fleet.js").Robot>} robots
   * @param {string} selected
   */
  draw(context, view, palette, robots, selected) {
    context.lineCap = "round";
    context.lineJoin = "round";
    // All trails of one fading in one stroke: a hundred robots would make three hundred.
    for (let piece = 0; piece < PIECES; piece++) {
      context.beginPath();
      for (const robot of robots) if (robot.name !== selected) this.#trace(context, view, robot, piece);
      // Light round dark, or dark round light: it is seen on the circle's line and on pictures, too.
      context.globalAlpha = 0.3 + 0.2 * piece;
      context.strokeStyle = palette.floor;
      context.lineWidth = 5;
      context.stroke();
      context.strokeStyle = palette.ink;
      context.lineWidth = 2.5;
      context.stroke();
      const robot = selected ? [...robots].find(({ name }) => name === selected) : undefined;
      if (robot === undefined) continue;
      context.beginPath();
      this.#trace(context, view, robot, piece);
      context.globalAlpha = 0.3 + 0.3 * piece;
      context.strokeStyle = palette.accent;
      context.lineWidth = 3;
      context.stroke();
    }
    context.globalAlpha = 1;
    context.lineCap = "butt";
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {import("./view.js").View} view
   * @param {import("./fleet.js").Robot} robot
   * @param {number} piece
   */
  #trace(context, view, robot, piece) {
    const marks = this.#marks.get(robot.name);
    if (marks === undefined || marks.length < 2) return;
    const first = Math.floor((marks.length * piece) / PIECES);
    const end = Math.min(marks.length, Math.floor((marks.length * (piece + 1)) / PIECES) + 1);
    for (let i = first; i < end; i++) {
      const mark = /** @type {Mark} */ (marks[i]);
      if (i === first) context.moveTo(view.px(mark.x), view.py(mark.y));
      else context.lineTo(view.px(mark.x), view.py(mark.y));
    }
    if (piece === PIECES - 1 && robot.placed) context.lineTo(view.px(robot.x), view.py(robot.y));
  }
}
