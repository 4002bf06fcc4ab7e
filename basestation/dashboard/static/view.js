/** Which part of the floor is looked at: between metres of the world and pixels of the canvas. */

const LEAST_SCALE = 8;
const MOST_SCALE = 3000;

/** Round what is shown when all of it is [px]. */
const EDGE = 26;

export class View {
  /** [px of CSS a metre] */
  scale = 100;
  /** The middle of the canvas, in the world [m]. */
  x = 0;
  y = 0;
  /** Of the canvas [px of CSS]. */
  width = 1;
  height = 1;
  /** Whether all of the arena is shown, and is to be when the canvas changes. */
  fitted = true;
  /** The robot that is followed; empty for none. */
  followed = "";

  /** @type {[number, number, number, number]} */
  #arena = [-1, -1, 1, 1];

  /**
   * @param {[number, number, number, number]} arena  x_min, y_min, x_max, y_max [m].
   */
  showArena(arena) {
    this.#arena = arena;
    if (this.fitted) this.fit();
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  resize(width, height) {
    this.width = width;
    this.height = height;
    if (this.fitted) this.fit();
  }

  /** Show all of the arena. */
  fit() {
    const [left, bottom, right, top] = this.#arena;
    this.fitted = true;
    this.followed = "";
    this.x = (left + right) / 2;
    this.y = (bottom + top) / 2;
    const wide = (this.width - 2 * EDGE) / Math.max(right - left, 0.01);
    const high = (this.height - 2 * EDGE) / Math.max(top - bottom, 0.01);
    this.scale = Math.max(LEAST_SCALE, Math.min(wide, high));
  }

  /**
   * @param {number} x  [m]
   * @returns {number} [px]
   */
  px(x) {
    return this.width / 2 + (x - this.x) * this.scale;
  }

  /**
   * @param {number} y  [m]
   * @returns {number} [px]
   */
  py(y) {
    return this.height / 2 - (y - this.y) * this.scale;
  }

  /**
   * @param {number} px
   * @param {number} py
   * @returns {[number, number]} [m, world]
   */
  toWorld(px, py) {
    return [this.x + (px - this.width / 2) / this.scale, this.y - (py - this.height / 2) / this.scale];
  }

  /**
   * Move the floor under the pointer.
   *
   * @param {number} dx  [px]
   * @param {number} dy
   */
  pan(dx, dy) {
    this.fitted = false;
    this.followed = "";
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  /**
   * Zoom in or out; the floor at a pixel stays there.
   *
   * @param {number} factor
   * @param {number} [px]
   * @param {number} [py]
   */
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.toWorld(px, py);
    this.fitted = false;
    this.scale = Math.min(MOST_SCALE, Math.max(LEAST_SCALE, this.scale * factor));
    this.x = x - (px - this.width / 2) / this.scale;
    this.y = y + (py - this.height / 2) / this.scale;
  }

  /**
   * Keep a place in the middle.
   *
   * @param {number} x  [m]
   * @param {number} y
   */
  centre(x, y) {
    this.fitted = false;
    this.x = x;
    this.y = y;
  }
}
