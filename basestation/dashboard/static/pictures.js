/** What the cameras see, under the robots: asked for only while it is wanted. */

/** @typedef {import("./protocol.js").Box} Box */

export class Pictures {
  /** Whether they are wanted. */
  on = false;

  /** @type {Map<string, {image: ImageBitmap, area: Box}>} */
  #newest = new Map();
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
   */
  want(cameras, on) {
    this.on = on;
    for (const camera of cameras) void this.#connection.ask({ order: "picture", camera, on });
    if (!on) this.#newest.clear();
  }

  /** @param {import("./protocol.js").Picture} picture */
  async take({ camera, jpeg, area }) {
    const image = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
    this.#newest.get(camera)?.image.close();
    if (!this.on) return image.close();
    this.#newest.set(camera, { image, area });
    this.#arrived();
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {import("./view.js").View} view
   * @returns {boolean} whether there was one to draw.
   */
  draw(context, view) {
    for (const { image, area } of this.#newest.values()) {
      const [left, bottom, right, top] = area;
      // What a camera does not see is black: where two overlap, the brighter is the one that sees it.
      context.globalCompositeOperation = "lighten";
      context.drawImage(image, view.px(left), view.py(top), (right - left) * view.scale, (top - bottom) * view.scale);
    }
    context.globalCompositeOperation = "source-over";
    return this.#newest.size > 0;
  }
}
