/** Words and figures for people. */

/** @type {Record<import("./protocol.js").Condition, string>} */
export const WORDS = {
  driving: "driving",
  holding: "holding",
  stopped: "stopped",
  failed: "failed",
  stale: "stale",
  lost: "lost",
  unseen: "not seen",
  absent: "no agent",
};

/**
 * A number; a dash when there is none.
 *
 * @param {number | null | undefined} value
 * @param {number} [digits]
 * @returns {string}
 */
export function figure(value, digits = 2) {
  return typeof value === "number" && Number.isFinite(value) ? value.toFixed(digits).replace("-", "−") : "–";
}

/**
 * A number with its unit; a dash when there is none.
 *
 * @param {number | null | undefined} value
 * @param {number} digits
 * @param {string} unit
 * @returns {string}
 */
export function amount(value, digits, unit) {
  const words = figure(value, digits);
  return words === "–" ? words : `${words} ${unit}`;
}

/**
 * A list as one says it: r1, r2 and r3.
 *
 * @param {string[]} names
 * @returns {string}
 */
export function listed(names) {
  return names.length < 2 ? names.join() : `${names.slice(0, -1).join(", ")} and ${names.at(-1)}`;
}

/**
 * A time of day.
 *
 * @param {number} t  [s since 1970]
 * @returns {string}
 */
export function clock(t) {
  return new Date(1000 * t).toTimeString().slice(0, 8);
}
