/** What the cameras see, under the robots: asked for only while it is wanted. */

import { figure } from "./words.js";

/** @typedef {import("./protocol.js").Box} Box */

/** Two a second come; one that is older than this says little about now, and looks it [s]. */
const OLD = 2;

/** How long it is remembered where the robots were [s]: a picture is some time under way. */
const REMEMBERED = 2;

/** @typedef {{t: number, x: number, y: number, radius: number}} Place */

export class Pictures {
  /** Whether they are wanted. */
  on = false;

  /** When the pictures of each camera were asked for. @type {Map<string, number>} */
  #asked = new Map();
  /** @type {Map<string, {image: ImageBitmap, area: Box, t: number}>} */
  #newest = new Map();
  /** Where each robot was, and when. @type {Map<string, Place[]>} */
  #places = new Map();
  /** @type {import("./connection.js").Connection} */
  #connection;
  /** @type {() => void} */
  #arrived;

  /**
   * @param {import("./connection.js").Connection} connection
   * @param {() => void} arrived  called when there is a new picture.
   */
  constructor(connection, arrived) {
    this.#connection = connection;
    this.#arrived = arrived;
  }

  /**
   * Ask for the pictures of all cameras, or for no more of them.
   *
   * @param {string[]} cameras
   * @param {boolean} on
   * @param {number} now  [s]
   * @returns {Promise<import("./protocol.js").Reply[]>} the answer about each camera.
   */
  want(cameras, on, now) {
    this.on = on;
    this.#asked = new Map(on ? cameras.map((camera) => [camera, now]) : []);
    if (!on) this.#newest.clear();
    return Promise.all(cameras.map((camera) => this.#connection.ask({ order: "picture", camera, on })));
  }

  /**
   * Which cameras send nothing now.
   *
   * @param {number} now  [s]
   * @returns {string[]}
   */
  silent(now) {
    const found = [];
    for (const [camera, asked] of this.#asked) {
      const newest = this.#newest.get(camera);
      const age = now - (newest?.t ?? asked);
      if (age > OLD) found.push(`camera ${camera}: ${newest ? `picture ${figure(age, 0)} s old` : "no picture yet"}`);
    }
    return found;
  }

  /**
   * Remember where the robots are.
   *
   * @param {Iterable<import("./fleet.js").Robot>} robots
   * @param {number} now  [s]
   */
  remember(robots, now) {
    if (!this.on) return;
    for (const { name, placed, x, y, age, facts } of robots) {
      let places = this.#places.get(name);
      if (places === undefined) this.#places.set(name, (places = []));
      while (places[0] !== undefined && places[0].t < now - REMEMBERED) places.shift();
      if (placed && age !== null) places.push({ t: now - age, x, y, radius: facts.radius });
    }
  }

  /** @param {import("./protocol.js").Picture} picture */
  async take({ camera, jpeg, area, t }) {
    const image = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
    this.#newest.get(camera)?.image.close();
    if (!this.on) return image.close();
    this.#newest.set(camera, { image, area, t });
    this.#arrived();
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {import("./view.js").View} view
   * @param {number} now  [s]
   * @returns {boolean} whether there was one to draw.
   */
  draw(context, view, now) {
    for (const { image, area, t } of this.#newest.values()) {
      const [left, bottom, right, top] = area;
      // What a camera does not see is black: where two overlap, the brighter is the one that sees it.
      context.globalCompositeOperation = "lighten";
      context.globalAlpha = now - t > OLD ? 0.3 : 1;
      context.drawImage(image, view.px(left), view.py(top), (right - left) * view.scale, (top - bottom) * view.scale);
    }
    context.globalCompositeOperation = "source-over";
    context.globalAlpha = 1;
    return this.#newest.size > 0;
  }

  /**
   * A ring where each robot was when a picture of it was taken: a picture is older than what is drawn over it.
   *
   * @param {CanvasRenderingContext2D} context
   * @param {import("./view.js").View} view
   */
  drawRings(context, view) {
    context.beginPath();
    for (const { area, t } of this.#newest.values()) {
      for (const places of this.#places.values()) {
        const place = nearest(places, t);
        if (place === undefined || !holds(area, place)) continue;
        const x = view.px(place.x);
        const radius = place.radius * view.scale;
        context.moveTo(x + radius, view.py(place.y));
        context.arc(x, view.py(place.y), radius, 0, 2 * Math.PI);
      }
    }
    context.strokeStyle = "#ffffff";
    context.lineWidth = 1.5;
    context.stroke();
  }
}

/**
 * The place at a time.
 *
 * @param {Place[]} places
 * @param {number} t  [s]
 */
function nearest(places, t) {
  /** @type {Place | undefined} */
  let best;
  for (const place of places) if (best === undefined || Math.abs(place.t - t) < Math.abs(best.t - t)) best = place;
  return best;
}

/**
 * @param {Box} area
 * @param {Place} place
 */
function holds([left, bottom, right, top], { x, y }) {
  return x >= left && x <= right && y >= bottom && y <= top;
}
