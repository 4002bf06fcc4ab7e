/** What robots intend: their Voronoi cells, planned paths, and goals. */

import { outlinePath } from "./floor_layer.js";

/** @typedef {CanvasRenderingContext2D} Context */
/** @typedef {import("./view.js").View} View */
/** @typedef {import("./palette.js").Palette} Palette */
/** @typedef {import("./fleet.js").Robot} Robot */
/** @typedef {import("./protocol.js").PlannedPath} PlannedPath */

/** The points of paths that were drawn before. @type {WeakMap<PlannedPath, [number, number][]>} */
const known = new WeakMap();

/** Arcs are drawn in steps of so many radians. */
const ARC_STEP = 0.1;

/** A goal that is no further from the end of a path is where the path leads to [m]. */
const SAME_PLACE = 0.02;

/**
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {Iterable<Robot>} robots
 * @param {string} selected
 */
export function drawPlans(context, view, palette, robots, selected) {
  for (const { name, details, condition } of robots) {
    const mine = name === selected;
    if (details.cell) drawCell(context, view, palette, details.cell, mine);
    if (condition === "holding" && !mine) continue; // it has arrived, or waits: its path is of the past
    if (details.path) drawPath(context, view, palette, details.path, mine);
    for (const goal of goalsOf(details)) drawGoal(context, view, palette, goal, mine);
  }
}

/**
 * Where a robot is to go: the end of its path, whoever sent it there; and the goal that it was given from a page, which
 * has a heading besides.
 *
 * @param {import("./protocol.js").Details} details
 * @returns {[number, number, number | null][]}
 */
function goalsOf({ path, goal }) {
  const end = path && pointsAlong(path).at(-1);
  const leadsThere = end && goal && Math.hypot(goal[0] - end[0], goal[1] - end[1]) <= SAME_PLACE;
  /** @type {[number, number, number | null][]} */
  const goals = end && !leadsThere ? [[...end, null]] : [];
  return goal ? [...goals, goal] : goals;
}

/**
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {NonNullable<import("./protocol.js").Details["cell"]>} cell
 * @param {boolean} selected
 */
function drawCell(context, view, palette, cell, selected) {
  if (cell.corners.length < 3) return;
  outlinePath(context, view, cell.corners);
  context.fillStyle = palette.accent;
  context.globalAlpha = selected ? 0.13 : 0.05;
  context.fill();
  context.globalAlpha = 0.5;
  context.strokeStyle = palette.accent;
  context.lineWidth = 1;
  context.stroke();
  const x = view.px(cell.x);
  const y = view.py(cell.y);
  context.beginPath();
  context.moveTo(x - 5, y);
  context.lineTo(x + 5, y);
  context.moveTo(x, y - 5);
  context.lineTo(x, y + 5);
  context.globalAlpha = 0.9;
  context.stroke();
  context.globalAlpha = 1;
}

/**
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {PlannedPath} path
 * @param {boolean} selected
 */
function drawPath(context, view, palette, path, selected) {
  context.beginPath();
  for (const [x, y] of pointsAlong(path)) context.lineTo(view.px(x), view.py(y));
  context.strokeStyle = palette.accent;
  context.globalAlpha = selected ? 0.95 : 0.55;
  context.lineWidth = selected ? 2 : 1.5;
  context.setLineDash([7, 4]);
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = 1;
}

/** The points of a path. @param {PlannedPath} path */
function pointsAlong(path) {
  let points = known.get(path);
  if (points === undefined) known.set(path, (points = [...pointsOf(path)]));
  return points;
}

/**
 * Points along a path, close enough for drawing.
 *
 * @param {PlannedPath} path
 * @returns {Generator<[number, number]>} [m, world]
 */
function* pointsOf(path) {
  let { x, y, theta } = path;
  yield [x, y];
  for (const [length, curvature] of path.segments) {
    const turn = length * curvature;
    const steps = Math.max(1, Math.ceil(Math.abs(turn) / ARC_STEP));
    for (let i = 0; i < steps; i++) {
      const step = length / steps;
      const half = (step * curvature) / 2;
      // The chord of an arc: shorter by sin(half)/half, and in the middle direction.
      const chord = half === 0 ? step : (step * Math.sin(half)) / half;
      x += chord * Math.cos(theta + half);
      y += chord * Math.sin(theta + half);
      theta += 2 * half;
      yield [x, y];
    }
  }
}

/**
 * A goal: a ring, with an arrow where a heading was asked for.
 *
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {[number, number, number | null]} goal
 * @param {boolean} selected
 */
export function drawGoal(context, view, palette, [x, y, theta], selected) {
  const px = view.px(x);
  const py = view.py(y);
  context.strokeStyle = palette.accent;
  context.fillStyle = palette.accent;
  context.globalAlpha = selected ? 1 : 0.7;
  context.lineWidth = 2;
  context.beginPath();
  context.arc(px, py, 7, 0, 2 * Math.PI);
  context.stroke();
  context.beginPath();
  context.arc(px, py, 2.5, 0, 2 * Math.PI);
  context.fill();
  if (theta !== null) {
    const [cos, sin] = [Math.cos(theta), -Math.sin(theta)];
    context.beginPath();
    context.moveTo(px + 7 * cos, py + 7 * sin);
    context.lineTo(px + 22 * cos, py + 22 * sin);
    context.stroke();
    context.beginPath();
    context.moveTo(px + 28 * cos, py + 28 * sin);
    context.lineTo(px + 19 * cos - 5 * sin, py + 19 * sin + 5 * cos);
    context.lineTo(px + 19 * cos + 5 * sin, py + 19 * sin - 5 * cos);
    context.closePath();
    context.fill();
  }
  context.globalAlpha = 1;
}
