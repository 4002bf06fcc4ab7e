/** The list of all robots, always: each with its condition and why; and those that have no place on the floor. */

import { changeSign, element, say, sign } from "./dom.js";
import { figure, WORDS } from "./words.js";

/** @typedef {import("./fleet.js").Robot} Robot */

/** What is said of a robot, in one line. @param {Robot} robot */
function inWords(robot) {
  const { condition, details } = robot;
  if (condition === "driving") return details.note;
  if ((condition === "lost" || condition === "stale") && robot.age !== null) {
    return details.reason || `last seen ${figure(robot.age, 1)} s ago`;
  }
  return details.reason;
}

export class RobotList {
  /** @type {Map<string, {row: HTMLButtonElement, sign: Element, condition: Element, reason: Element, speed: Element}>} */
  #rows = new Map();

  /**
   * @param {HTMLElement} list
   * @param {HTMLElement} aside  where those stand that have no place.
   * @param {import("./fleet.js").Fleet} fleet
   * @param {(name: string) => void} choose
   */
  constructor(list, aside, fleet, choose) {
    this.list = list;
    this.aside = aside;
    this.fleet = fleet;
    this.choose = choose;
  }

  /** @param {string} selected */
  update(selected) {
    const names = [...this.fleet.robots.keys()];
    if (names.join() !== [...this.#rows.keys()].join()) this.#make(names);
    for (const robot of this.fleet.robots.values()) {
      const parts = this.#rows.get(robot.name);
      if (parts === undefined) continue;
      changeSign(parts.sign, robot.condition);
      const { behaviour } = robot.details;
      say(parts.condition, WORDS[robot.condition] + (behaviour ? ` · ${behaviour}` : ""));
      say(parts.reason, inWords(robot));
      say(parts.speed, robot.placed && robot.condition !== "lost" ? `${figure(robot.v, 2)} m/s` : "");
      parts.row.setAttribute("aria-pressed", String(robot.name === selected));
    }
    this.#standAside();
  }

  /** @param {string[]} names */
  #make(names) {
    this.#rows.clear();
    this.list.replaceChildren();
    for (const name of names) {
      const parts = {
        sign: sign("unseen"),
        condition: element("span", { className: "condition" }),
        reason: element("span", { className: "reason" }),
        speed: element("span", { className: "speed" }),
      };
      const row = element(
        "button",
        { type: "button", className: "robot", onclick: () => this.choose(name) },
        parts.sign,
        element("strong", {}, name),
        parts.condition,
        parts.speed,
        parts.reason,
      );
      this.list.append(element("li", {}, row));
      this.#rows.set(name, { row, ...parts });
    }
  }

  #standAside() {
    if (this.fleet.state === null) return; // or it would come and go, and move the floor under the first click
    const missing = [...this.fleet.robots.values()].filter((robot) => !robot.placed || robot.condition === "absent");
    const text = missing.map((robot) => `${robot.name} ${robot.condition} ${robot.details.reason}`).join();
    if (this.aside.dataset.of === text) return;
    this.aside.dataset.of = text;
    this.aside.hidden = missing.length === 0;
    this.aside.replaceChildren(
      ...missing.map((robot) =>
        element(
          "li",
          {},
          sign(robot.condition),
          element("strong", {}, robot.name),
          element("span", {}, robot.details.reason || WORDS[robot.condition]),
        ),
      ),
    );
  }
}
