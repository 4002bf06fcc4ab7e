/** The stick of a robot that is driven by hand, and how fast its pace is. */

import { element } from "./dom.js";
import { Stick } from "./stick.js";

export class HandPanel {
  #stick;

  /** @param {import("./driving.js").Driving} driving */
  constructor(driving) {
    this.driving = driving;
    const knob = element("span", { className: "knob" });
    const pad = element("div", { className: "pad", ariaHidden: "true" }, knob);
    this.#stick = new Stick(pad, knob, (forwards, left) => driving.steer(forwards, left));
    const pace = element("input", { type: "range", min: "0.1", max: "1", step: "0.1", value: String(driving.pace) });
    pace.oninput = () => (driving.pace = Number(pace.value));
    // Moved with a pointer it gives the keys back, which drive; somebody who moves it with the keys goes on doing so.
    pace.onpointerdown = () => window.addEventListener("pointerup", () => pace.blur(), { once: true });
    this.element = element(
      "div",
      { className: "hand" },
      pad,
      element(
        "div",
        {},
        element("p", { className: "hint" }, "Arrow keys or W A S D, or the stick. Let go and the robot stands."),
        element("label", {}, "Pace", pace),
      ),
    );
  }

  /** The finger on the stick must come anew. */
  release() {
    this.#stick.release();
  }

  /** Show where the stick is, by whatever hand. */
  showWish() {
    this.#stick.show(this.driving.wish);
  }
}
