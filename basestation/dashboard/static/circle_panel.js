/** The circle: moved and resized by hand on the floor, or by numbers. */

import { element, say } from "./dom.js";

/** @typedef {import("./protocol.js").Circle} Circle */

export class CirclePanel {
  #shown = "";
  /** Whether something else has been entered, and not ordered yet. */
  #entered = false;
  #x = number("x");
  #y = number("y");
  #radius = number("radius");
  #clockwise = element("input", { type: "checkbox", name: "clockwise" });
  #grab = element("button", {
    type: "button",
    className: "quiet",
    textContent: "Move on the floor",
    ariaPressed: "false",
  });

  /**
   * @param {HTMLElement} panel
   * @param {import("./arena.js").Arena} arena
   * @param {import("./orders.js").Orders} orders
   */
  constructor(panel, arena, orders) {
    this.arena = arena;
    this.orders = orders;
    const form = element(
      "form",
      {},
      element("div", { className: "bar" }, element("h2", {}, "Circle"), this.#grab),
      element(
        "div",
        { className: "triple" },
        element("label", {}, "x [m]", this.#x),
        element("label", {}, "y [m]", this.#y),
        element("label", {}, "radius [m]", this.#radius),
      ),
      element(
        "div",
        { className: "bar" },
        element("label", { className: "tick" }, this.#clockwise, "clockwise"),
        element("button", { type: "submit", textContent: "Set" }),
      ),
    );
    form.oninput = () => (this.#entered = true);
    form.onsubmit = (event) => {
      event.preventDefault();
      this.#entered = false;
      this.give({
        x: Number(this.#x.value),
        y: Number(this.#y.value),
        radius: Number(this.#radius.value),
        clockwise: this.#clockwise.checked,
      });
    };
    this.#grab.onclick = () => this.#toggle();
    this.form = form;
    panel.append(form);
  }

  /** Show what is new, unless somebody is entering something else. */
  update() {
    const { circle, maySteer } = this.arena.fleet;
    for (const field of this.form.querySelectorAll("input, button")) Reflect.set(field, "disabled", !maySteer);
    const shown = JSON.stringify(circle);
    const entering = this.#entered && this.form.contains(document.activeElement);
    if (circle === null || shown === this.#shown || entering) return;
    [this.#shown, this.#entered] = [shown, false];
    this.#x.value = String(round(circle.x));
    this.#y.value = String(round(circle.y));
    this.#radius.value = String(round(circle.radius));
    this.#clockwise.checked = circle.clockwise;
  }

  /** @param {Pick<Circle, "x" | "y" | "radius" | "clockwise">} circle */
  give({ x, y, radius, clockwise }) {
    const words = `Circle of ${round(radius)} m at (${round(x)}, ${round(y)})`;
    const order = { order: "circle", x: round(x), y: round(y), radius: round(radius), clockwise };
    void this.orders.give(words, order).then((reply) => {
      const { arena } = this;
      if (reply.outcome !== "taken") {
        // The form and the handles go back to the circle that is in force.
        this.#shown = "";
        if (arena.circle !== null) arena.circle = arena.fleet.circle && { ...arena.fleet.circle };
      }
      arena.redraw();
    });
  }

  #toggle() {
    const { arena } = this;
    const { circle } = arena.fleet;
    arena.circle = arena.circle === null && circle !== null ? { ...circle } : null;
    this.#grab.ariaPressed = String(arena.circle !== null);
    say(this.#grab, arena.circle === null ? "Move on the floor" : "Done");
    arena.redraw();
  }
}

/** @param {string} name */
function number(name) {
  return element("input", {
    type: "number",
    step: "any",
    name,
    required: true,
    inputMode: "decimal",
    ...(name === "radius" ? { min: "0.05" } : {}),
  });
}

/** To millimetres. @param {number} metres */
function round(metres) {
  return Math.round(metres * 1000) / 1000;
}
