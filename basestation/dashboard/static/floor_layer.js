/** What lies on the floor: the arena with its walls, what cameras see, the circle with its importance, the gaps on it. */

/** @typedef {CanvasRenderingContext2D} Context */
/** @typedef {import("./view.js").View} View */
/** @typedef {import("./palette.js").Palette} Palette */
/** @typedef {import("./protocol.js").Circle} Circle */
/** @typedef {import("./fleet.js").Fleet} Fleet */

/** Between the circle and an importance of nothing, and of 1 [fractions of the radius]. */
const BAND = 0.1;
const BAND_HEIGHT = 0.13;

export const FONT = "Inter, system-ui, sans-serif";

/**
 * Letters on the canvas: larger where there is room, as on a projector.
 *
 * @param {View} view
 */
export const small = (view) => `${Math.round(11 * room(view))}px ${FONT}`;

/** @param {View} view */
export const bold = (view) => `600 ${Math.round(12 * room(view))}px ${FONT}`;

/** @param {View} view */
export const room = ({ width }) => Math.min(1.6, Math.max(1, width / 1050));

/** More robots than that leave no room for the values of their gaps. */
const MOST_GAPS = 24;

/** Where along a gap its value may stand, the best first; and the room that it needs round its middle [px]. */
const VALUE_AT = [0.5, 0.35, 0.65, 0.2, 0.8];
const VALUE_ROOM = 14;

/**
 * The floor, with a grid.
 *
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {import("./protocol.js").Box} arena
 * @param {boolean} covered  whether pictures cover it.
 */
export function drawFloor(context, view, palette, [left, bottom, right, top], covered) {
  const x = view.px(left);
  const y = view.py(top);
  const width = view.px(right) - x;
  const height = view.py(bottom) - y;
  if (!covered) {
    context.fillStyle = palette.floor;
    context.fillRect(x, y, width, height);
  }
  const step = [0.1, 0.5, 1, 5, 10, 50].find((metres) => metres * view.scale >= 40) ?? 100;
  context.beginPath();
  for (let at = Math.ceil(left / step) * step; at <= right; at += step) {
    context.moveTo(Math.round(view.px(at)) + 0.5, y);
    context.lineTo(Math.round(view.px(at)) + 0.5, y + height);
  }
  for (let at = Math.ceil(bottom / step) * step; at <= top; at += step) {
    context.moveTo(x, Math.round(view.py(at)) + 0.5);
    context.lineTo(x + width, Math.round(view.py(at)) + 0.5);
  }
  context.globalAlpha = covered ? 0.25 : 0.7;
  context.strokeStyle = palette.line;
  context.lineWidth = 1;
  context.stroke();
  context.globalAlpha = 1;
  context.strokeStyle = palette.faint;
  context.lineWidth = 1.5;
  context.strokeRect(x, y, width, height);
  context.fillStyle = palette.muted;
  context.font = small(view);
  context.textAlign = "right";
  context.textBaseline = "top";
  halo(context, palette, `grid ${step} m`, x + width - 2, y + height + 6, palette.muted);
}

/**
 * The walls inside the arena.
 *
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {import("./protocol.js").Wall[]} walls
 */
export function drawWalls(context, view, palette, walls) {
  context.beginPath();
  for (const [x, y, endX, endY] of walls) {
    context.moveTo(view.px(x), view.py(y));
    context.lineTo(view.px(endX), view.py(endY));
  }
  context.strokeStyle = palette.ink;
  context.lineWidth = Math.max(3, 0.03 * view.scale);
  context.lineCap = "round";
  context.stroke();
  context.lineCap = "butt";
}

/**
 * The floor that each camera sees.
 *
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {Record<string, {outline: import("./protocol.js").Point[]}>} cameras
 */
export function drawCameras(context, view, palette, cameras) {
  context.font = small(view);
  context.textAlign = "left";
  for (const [name, { outline }] of Object.entries(cameras)) {
    if (outline.length === 0) continue;
    outlinePath(context, view, outline);
    context.strokeStyle = palette.faint;
    context.lineWidth = 1;
    context.setLineDash([2, 5]);
    context.stroke();
    context.setLineDash([]);
    // Its name stands at the corner that is farthest from the middle, inside the canvas.
    const corner = outline.reduce((a, b) => (b[1] - b[0] > a[1] - a[0] ? b : a));
    const middle = outline.reduce((sum, point) => sum + point[1], 0) / outline.length;
    const upper = middle >= view.y;
    const low = outline.reduce((a, b) => (-b[1] - b[0] > -a[1] - a[0] ? b : a));
    const [x, y] = upper ? corner : low;
    context.textBaseline = upper ? "top" : "bottom";
    const px = Math.max(8, view.px(x) + 6);
    const py = upper ? Math.max(6, view.py(y) + 5) : Math.min(view.height - 6, view.py(y) - 5);
    halo(context, palette, `camera ${name}`, px, py, palette.muted);
  }
}

/**
 * @param {Context} context
 * @param {View} view
 * @param {import("./protocol.js").Point[]} outline
 */
export function outlinePath(context, view, outline) {
  context.beginPath();
  for (const [x, y] of outline) context.lineTo(view.px(x), view.py(y));
  context.closePath();
}

/**
 * The circle, with an arrow in the direction of travel, and where it is more important.
 *
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {Circle} circle
 */
export function drawCircle(context, view, palette, circle) {
  const x = view.px(circle.x);
  const y = view.py(circle.y);
  const radius = circle.radius * view.scale;
  if (circle.importance?.length) drawImportance(context, view, palette, circle, circle.importance);
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.strokeStyle = palette.accent;
  context.globalAlpha = 0.55;
  context.lineWidth = 1.5;
  context.stroke();
  context.beginPath();
  context.moveTo(x - 5, y);
  context.lineTo(x + 5, y);
  context.moveTo(x, y - 5);
  context.lineTo(x, y + 5);
  context.stroke();
  // An arrowhead on top of the circle.
  const ahead = circle.clockwise ? 1 : -1;
  context.beginPath();
  context.moveTo(x + 7 * ahead, y - radius);
  context.lineTo(x - 3 * ahead, y - radius - 5);
  context.lineTo(x - 3 * ahead, y - radius + 5);
  context.closePath();
  context.fillStyle = palette.accent;
  context.fill();
  context.globalAlpha = 1;
}

/**
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {Circle} circle
 * @param {number[]} importance
 */
function drawImportance(context, view, palette, circle, importance) {
  const count = importance.length;
  context.beginPath();
  for (let k = 0; k <= count; k++) {
    const angle = (2 * Math.PI * k) / count;
    const r = circle.radius * (1 + BAND + BAND_HEIGHT * /** @type {number} */ (importance[k % count]));
    context.lineTo(view.px(circle.x + r * Math.cos(angle)), view.py(circle.y + r * Math.sin(angle)));
  }
  context.strokeStyle = palette.importance;
  context.lineWidth = 1.5;
  context.stroke();
  context.arc(view.px(circle.x), view.py(circle.y), circle.radius * (1 + BAND) * view.scale, 0, 2 * Math.PI);
  context.fillStyle = palette.importance;
  context.globalAlpha = 0.16;
  context.fill("evenodd");
  context.globalAlpha = 1;
}

/**
 * The gaps between robots on the circle, with their values.
 *
 * @param {Context} context
 * @param {View} view
 * @param {Palette} palette
 * @param {Fleet} fleet
 * @param {Circle} circle
 */
export function drawGaps(context, view, palette, fleet, circle) {
  const gaps = Object.entries(fleet.gaps);
  if (gaps.length < 2 || gaps.length > MOST_GAPS) return;
  const sense = circle.clockwise ? -1 : 1;
  context.font = small(view);
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (const [name, gap] of gaps) {
    const robot = fleet.robots.get(name);
    if (robot === undefined || !robot.placed) continue;
    const from = Math.atan2(robot.y - circle.y, robot.x - circle.x);
    const inner = circle.radius * view.scale - Math.max(26, robot.facts.radius * view.scale + 12);
    if (inner < 24) return;
    const x = view.px(circle.x);
    const y = view.py(circle.y);
    const edge = Math.min(0.05, gap / 6);
    context.beginPath();
    context.arc(x, y, inner, -(from + sense * edge), -(from + sense * (gap - edge)), sense > 0);
    context.strokeStyle = palette.muted;
    context.globalAlpha = 0.45;
    context.lineWidth = 1;
    context.stroke();
    context.globalAlpha = 1;
    const value = VALUE_AT.map((part) => {
      const angle = from + sense * part * gap;
      return { x: x + (inner - 2) * Math.cos(angle), y: y - (inner - 2) * Math.sin(angle) };
    });
    const free = value.find((place) => !isCovered(place, view, fleet)) ?? value[0];
    if (free === undefined) continue;
    halo(context, palette, `${Math.round((gap * 180) / Math.PI)}°`, free.x, free.y, palette.muted);
  }
}

/**
 * Whether a robot, which is drawn later, would cover a value.
 *
 * @param {{x: number, y: number}} place  of the value [px]
 * @param {View} view
 * @param {Fleet} fleet
 */
function isCovered(place, view, fleet) {
  for (const { placed, x, y, facts } of fleet.robots.values()) {
    const far = facts.radius * view.scale + VALUE_ROOM;
    if (placed && Math.hypot(view.px(x) - place.x, view.py(y) - place.y) < far) return true;
  }
  return false;
}

/**
 * A text that can be read on whatever is below it.
 *
 * @param {Context} context
 * @param {Palette} palette
 * @param {string} text
 * @param {number} x  [px]
 * @param {number} y
 * @param {string} colour
 */
export function halo(context, palette, text, x, y, colour) {
  context.lineJoin = "round";
  context.lineWidth = 4;
  context.strokeStyle = palette.rim;
  context.strokeText(text, x, y);
  context.fillStyle = colour;
  context.fillText(text, x, y);
}
