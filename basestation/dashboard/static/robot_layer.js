/** The robots, to scale: their condition by shape and colour, heading, name, and where the separation filter acts. */

import { bold, halo, room, small } from "./floor_layer.js";
import { figure, WORDS } from "./words.js";

/** @typedef {CanvasRenderingContext2D} Context */
/** @typedef {import("./view.js").View} View */
/** @typedef {import("./palette.js").Palette} Palette */
/** @typedef {import("./fleet.js").Robot} Robot */

/** A robot is drawn no smaller than that, however far away [px]. */
const LEAST_RADIUS = 5;

/** Names of more robots than that are drawn only of those that are in trouble, when they are small. */
const CROWD = 40;

/**
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {Robot[]} robots
 * @param {string} selected
 * @param {boolean} covered  whether they lie on pictures, which are to be seen through them.
 */
export function drawRobots(context, view, palette, robots, selected, covered) {
  // Lost ones at the bottom: what drives must not be hidden by what once was.
  for (const lost of [true, false]) {
    for (const robot of robots) {
      if (robot.placed && (robot.condition === "lost") === lost) {
        drawRobot(context, view, palette, robot, robot.name === selected, covered);
      }
    }
  }
  const named = robots.length <= CROWD || view.scale > 150;
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const robot of robots) {
    if (robot.placed && (named || robot.name === selected || robot.condition !== "driving"))
      drawName(context, view, palette, robot);
  }
}

/**
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {Robot} robot
 * @param {boolean} selected
 * @param {boolean} covered
 */
function drawRobot(context, view, palette, robot, selected, covered) {
  const x = view.px(robot.x);
  const y = view.py(robot.y);
  const radius = Math.max(LEAST_RADIUS, robot.facts.radius * view.scale);
  const { condition } = robot;
  const colour = palette.robots[condition];
  if (robot.details.note && condition === "driving") {
    ring(context, x, y, radius + Math.max(4, robot.facts.margin * view.scale), palette.robots.holding, [3, 4], 2);
  }
  if (selected) ring(context, x, y, radius + 6, palette.accent, [], 2.5);
  context.save();
  context.translate(x, y);
  context.rotate(-robot.theta);
  context.globalAlpha = condition === "lost" || covered ? 0.6 : 1;
  context.lineWidth = Math.max(2, radius * 0.1);
  context.strokeStyle = colour;
  context.fillStyle = condition === "driving" || condition === "stopped" ? colour : palette.surface;
  context.setLineDash(condition === "stale" || condition === "lost" || condition === "absent" ? [5, 4] : []);
  context.beginPath();
  if (condition === "stopped") octagon(context, radius);
  else context.arc(0, 0, radius - context.lineWidth / 2, 0, 2 * Math.PI);
  context.fill();
  context.stroke();
  context.setLineDash([]);
  const mark = condition === "driving" || condition === "stopped" ? palette.surface : colour;
  context.strokeStyle = context.fillStyle = mark;
  if (condition === "driving") arrow(context, radius);
  else nose(context, radius);
  context.rotate(robot.theta); // what follows stands upright
  sign(context, condition, radius);
  context.restore();
}

/**
 * @param {Context} context
 * @param {number} radius
 */
function octagon(context, radius) {
  const corner = radius / Math.cos(Math.PI / 8);
  for (let k = 0; k < 8; k++) {
    const angle = (k + 0.5) * (Math.PI / 4);
    context.lineTo(0.96 * corner * Math.cos(angle), 0.96 * corner * Math.sin(angle));
  }
  context.closePath();
}

/**
 * The heading of a robot that drives: all of it is an arrow.
 *
 * @param {Context} context
 * @param {number} r
 */
function arrow(context, r) {
  context.beginPath();
  context.moveTo(0.68 * r, 0);
  context.lineTo(-0.42 * r, 0.5 * r);
  context.lineTo(-0.2 * r, 0);
  context.lineTo(-0.42 * r, -0.5 * r);
  context.closePath();
  context.fill();
}

/**
 * The heading of a robot that stands: a notch at its edge.
 *
 * @param {Context} context
 * @param {number} r
 */
function nose(context, r) {
  context.beginPath();
  context.moveTo(0.9 * r, 0);
  context.lineTo(0.56 * r, 0.22 * r);
  context.lineTo(0.56 * r, -0.22 * r);
  context.closePath();
  context.fill();
}

/**
 * Two bars for one that waits, a square for one that is stopped, a cross for one that is lost, a stroke for one without
 * an agent, a clock for one that is stale, an exclamation mark for one that failed.
 *
 * @param {Context} context
 * @param {import("./protocol.js").Condition} condition
 * @param {number} r
 */
function sign(context, condition, r) {
  context.lineWidth = Math.max(1.5, 0.13 * r);
  context.lineCap = "round";
  context.beginPath();
  if (condition === "holding") {
    for (const x of [-0.15 * r, 0.15 * r]) {
      context.moveTo(x, -0.26 * r);
      context.lineTo(x, 0.26 * r);
    }
  } else if (condition === "stopped") {
    context.rect(-0.26 * r, -0.26 * r, 0.52 * r, 0.52 * r);
    context.fill();
    return;
  } else if (condition === "lost" || condition === "absent") {
    context.moveTo(-0.28 * r, -0.28 * r);
    context.lineTo(0.28 * r, 0.28 * r);
    if (condition === "lost") {
      context.moveTo(-0.28 * r, 0.28 * r);
      context.lineTo(0.28 * r, -0.28 * r);
    }
  } else if (condition === "stale") {
    // The hands of a clock.
    context.moveTo(0, -0.36 * r);
    context.lineTo(0, 0);
    context.lineTo(0.24 * r, 0.12 * r);
  } else if (condition === "failed") {
    context.moveTo(0, -0.36 * r);
    context.lineTo(0, 0.08 * r);
    context.moveTo(0, 0.34 * r);
    context.lineTo(0, 0.35 * r);
  }
  context.stroke();
}

/**
 * @param {Context} context
 * @param {number} x
 * @param {number} y
 * @param {number} radius
 * @param {string} colour
 * @param {number[]} dash
 * @param {number} width
 */
function ring(context, x, y, radius, colour, dash, width) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

/**
 * The name under a robot; beside it what is wrong with it.
 *
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {Robot} robot
 */
function drawName(context, view, palette, robot) {
  const { condition } = robot;
  const x = view.px(robot.x);
  const y = view.py(robot.y) + Math.max(LEAST_RADIUS, robot.facts.radius * view.scale) + 5;
  context.font = bold(view);
  halo(context, palette, robot.name, x, y, condition === "lost" ? palette.muted : palette.ink);
  if (condition === "driving" || condition === "holding" || condition === "stopped") return;
  const aged = condition === "lost" || condition === "stale";
  context.font = small(view);
  const words = aged ? `${WORDS[condition]} ${figure(robot.age, (robot.age ?? 0) < 10 ? 1 : 0)} s` : WORDS[condition];
  halo(context, palette, words, x, y + 14 * room(view), palette.muted);
}
