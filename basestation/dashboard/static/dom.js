/** Making and changing elements, and little else. */

/**
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, any>} [properties]  properties, attributes, and listeners as `onclick`.
 * @param {...(Node | string)} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key in made) Reflect.set(made, key, value);
    else made.setAttribute(key, String(value));
  }
  made.append(...children);
  return made;
}

/**
 * The element with an id.
 *
 * @template {HTMLElement} T
 * @param {string} id
 * @param {new () => T} kind
 * @returns {T}
 */
export function byId(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`index.html: got no ${kind.name} #${id}`);
  return found;
}

/**
 * Say something, without work for the browser when it is said already.
 *
 * @param {Element} where
 * @param {string} text
 */
export function say(where, text) {
  if (where.textContent !== text) where.textContent = text;
}

/**
 * The sign of a robot's condition: a shape and a colour.
 *
 * @param {string} condition
 * @returns {SVGSVGElement}
 */
export function sign(condition) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
  made.setAttribute("viewBox", "0 0 20 20");
  made.setAttribute("aria-hidden", "true");
  made.append(use);
  changeSign(made, condition);
  return made;
}

/**
 * @param {Element} made
 * @param {string} condition
 */
export function changeSign(made, condition) {
  if (made.getAttribute("class") === `sign ${condition}`) return;
  made.setAttribute("class", `sign ${condition}`);
  made.firstElementChild?.setAttribute("href", `#sign-${condition}`);
}
