/** A goal by its numbers: for those who do not click. */

import { element } from "./dom.js";

/**
 * @param {(x: number, y: number, theta: number | null) => void} go  called with the goal [m, rad, world].
 * @returns {HTMLFormElement}
 */
export function goalForm(go) {
  const form = element(
    "form",
    { className: "goal" },
    field("x [m]", "x", true),
    field("y [m]", "y", true),
    field("heading [°]", "theta", false),
    element("button", { type: "submit", textContent: "Go" }),
    element("p", { className: "hint" }, "Or click the floor; drag for a heading."),
  );
  form.onsubmit = (event) => {
    event.preventDefault();
    const entered = new FormData(form);
    const theta = entered.get("theta");
    go(Number(entered.get("x")), Number(entered.get("y")), theta ? (Number(theta) * Math.PI) / 180 : null);
  };
  return form;
}

/**
 * @param {string} label
 * @param {string} name
 * @param {boolean} required
 */
function field(label, name, required) {
  return element(
    "label",
    {},
    label,
    element("input", { type: "number", step: "any", name, required, inputMode: "decimal" }),
  );
}
