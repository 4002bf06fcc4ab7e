/** The robot that was chosen: what is known of it, and what can be done with it. */

import { element, say } from "./dom.js";
import { HAND } from "./driving.js";
import { goalForm } from "./goal_form.js";
import { HandPanel } from "./hand_panel.js";
import { Receipt } from "./receipt.js";
import { figure, WORDS } from "./words.js";

/** @typedef {import("./fleet.js").Robot} Robot */

/** What a behaviour needs that drives to goals. */
const GOAL = "goal";

export class RobotCard {
  #made = "";
  /** @type {Record<string, HTMLElement>} */
  #figures = {};
  /** @type {HandPanel | null} */
  #hand = null;
  /** @type {HTMLElement | null} */
  #follow = null;
  /** What came of the stop of this robot. */
  #stopped = { name: "", element: element("div", {}) };

  /**
   * @param {HTMLElement} card
   * @param {import("./arena.js").Arena} arena
   * @param {import("./orders.js").Orders} orders
   * @param {import("./driving.js").Driving} driving
   * @param {import("./stop.js").StopDesk} stop
   */
  constructor(card, arena, orders, driving, stop) {
    this.card = card;
    this.arena = arena;
    this.fleet = arena.fleet;
    this.orders = orders;
    this.driving = driving;
    this.stop = stop;
  }

  /** @returns {Robot | undefined} */
  get robot() {
    return this.fleet.robots.get(this.arena.selected);
  }

  /** Show what is known now. */
  update() {
    const { robot } = this;
    const driven = robot !== undefined && this.driving.name === robot.name;
    if (driven && !this.fleet.needs(robot.details.behaviour, HAND) && this.#made.endsWith("driven"))
      this.driving.take("");
    const kind = this.#kind(robot);
    if (kind !== this.#made) {
      const another = kind.split(" ")[0] !== this.#made.split(" ")[0];
      this.#made = kind;
      this.#make(robot);
      if (another || driven) (this.#hand?.element ?? this.card).scrollIntoView({ block: "nearest" });
    }
    if (robot === undefined) return;
    const { details } = robot;
    if (this.#follow !== null) this.#follow.ariaPressed = String(this.arena.view.followed === robot.name);
    const [cal0, calD] = details.cal;
    const degrees = (robot.theta * 180) / Math.PI;
    this.#say("condition", WORDS[robot.condition] + (details.reason ? `: ${details.reason}` : ""));
    this.#say("behaviour", details.behaviour ?? "–");
    this.#say(
      "place",
      robot.placed ? `${figure(robot.x)}, ${figure(robot.y)} m, ${figure(degrees, 0)}°` : "never seen",
    );
    this.#say("speed", `${figure(robot.v)} m/s, ${figure(robot.omega)} rad/s`);
    this.#say("command", `${figure(robot.command[0])} m/s, ${figure(robot.command[1])} rad/s`);
    this.#say("age", robot.age === null ? "–" : `${figure(robot.age * 1000, 0)} ms ago`);
    this.#say("calibration", `${figure(calD, 3)}, turning ${figure(cal0, 3)}`);
    this.#say("note", [details.note, details.wheels, ...details.complaints].filter(Boolean).join("; ") || "–");
  }

  /** Whoever has a finger on the stick must come anew. */
  releaseStick() {
    this.#hand?.release();
  }

  /** Show where the stick is. */
  showWish() {
    this.#hand?.showWish();
  }

  /**
   * Send the robot to a goal.
   *
   * @param {number} x  [m, world]
   * @param {number} y
   * @param {number | null} theta  [rad]
   */
  sendTo(x, y, theta) {
    const { robot } = this;
    if (robot === undefined) return;
    const { name } = robot;
    const heading = theta === null ? "" : `, heading ${figure((theta * 180) / Math.PI, 0)}°`;
    const words = `${name} to (${figure(x)}, ${figure(y)})${heading}`;
    const order = { order: "goal", name, x, y, theta };
    const other = this.fleet.needs(robot.details.behaviour, GOAL) ? "" : this.fleet.needing(GOAL);
    if (!other) return void this.orders.give(words, order);
    void this.orders.give(words, order, {
      label: `Run ${other} on ${name}, then go`,
      does: () => void this.#switchAndGo(name, words, order),
    });
  }

  /**
   * @param {string} name
   * @param {string} words
   * @param {Record<string, unknown>} order
   */
  async #switchAndGo(name, words, order) {
    if (await this.#runs(name, GOAL)) void this.orders.give(words, order);
  }

  /**
   * Have a robot run a behaviour that needs an input, and wait until it does: it takes a new one when it hears of it,
   * not when it is ordered.
   *
   * @param {string} name
   * @param {string} input
   * @returns {Promise<boolean>} whether it does.
   */
  async #runs(name, input) {
    const does = () => this.fleet.needs(this.fleet.robots.get(name)?.details.behaviour ?? null, input);
    if (does()) return true;
    const behaviour = this.fleet.needing(input);
    const order = { order: "behaviour", behaviour, parameters: {}, names: [name] };
    const { outcome } = await this.orders.give(`${name}: ${behaviour}`, order);
    for (let wait = 0; outcome === "taken" && wait < 30 && !does(); wait++) {
      await new Promise((resolve) => setTimeout(resolve, 100));
    }
    return does();
  }

  /**
   * What the card looks like, in a word that changes when it must be made anew.
   *
   * @param {Robot | undefined} robot
   */
  #kind(robot) {
    if (robot === undefined) return "";
    const { maySteer, stop } = this.fleet;
    const { condition } = robot;
    const driven = this.driving.name === robot.name ? "driven" : "";
    return [robot.name, maySteer, condition === "lost", stop.all, this.fleet.isStopped(robot.name), driven].join(" ");
  }

  /** @param {Robot | undefined} robot */
  #make(robot) {
    this.card.hidden = robot === undefined;
    // The stick that a hand may hold is about to go: without it nothing would say when the hand is taken off.
    if (this.#hand !== null) this.driving.letGo();
    this.#figures = {};
    const driven = robot !== undefined && this.driving.name === robot.name;
    this.#hand = driven ? new HandPanel(this.driving) : null;
    if (robot === undefined) return this.card.replaceChildren();
    const { name } = robot;
    const close = element("button", { type: "button", className: "quiet", textContent: "Close" });
    close.onclick = () => {
      this.arena.selected = "";
      this.driving.take("");
      this.update();
      this.arena.redraw();
    };
    this.card.replaceChildren(
      element("div", { className: "bar" }, element("h2", {}, name), close),
      ...(this.#hand === null ? [] : [this.#hand.element]),
      this.#buttons(robot),
      this.#receiptOf(name),
      this.#facts(),
    );
    if (this.fleet.maySteer && !driven) this.card.append(goalForm((x, y, theta) => this.sendTo(x, y, theta)));
  }

  #facts() {
    const list = element("dl", {});
    const rows = {
      condition: "Now",
      behaviour: "Behaviour",
      place: "Place",
      speed: "Speed",
      command: "Commanded",
      age: "Last seen",
      calibration: "Calibration",
      note: "Note",
    };
    for (const [key, title] of Object.entries(rows)) {
      const value = element("dd", {});
      this.#figures[key] = value;
      list.append(element("div", {}, element("dt", {}, title), value));
    }
    return list;
  }

  /** Where the receipt of a robot's stop is shown: it stays while the card is made anew. @param {string} name */
  #receiptOf(name) {
    if (this.#stopped.name !== name) this.#stopped = { name, element: element("div", { role: "status" }) };
    return this.#stopped.element;
  }

  /** @param {Robot} robot */
  #buttons({ name, condition }) {
    const { fleet, arena, orders, driving, stop } = this;
    /**
     * @param {string} label
     * @param {() => void} does
     * @param {boolean} [pressed]
     */
    const button = (label, does, pressed) => {
      const made = element("button", { type: "button", className: "quiet", textContent: label, onclick: does });
      if (pressed !== undefined) made.ariaPressed = String(pressed);
      return made;
    };
    const row = element("div", { className: "buttons" });
    row.append(button(`Stop ${name}`, () => void stop.stop([name], new Receipt(this.#receiptOf(name)))));
    if (fleet.maySteer && fleet.isStopped(name) && !fleet.stop.all) {
      row.append(stop.resumeButton(name, [name]).element);
    }
    this.#follow = button("Follow", () => {
      arena.view.followed = arena.view.followed === name ? "" : name;
      arena.redraw();
    });
    row.append(this.#follow);
    if (!fleet.maySteer) return row;
    if (condition === "lost") {
      row.append(button("Remove from the floor", () => void orders.give(`Forget ${name}`, { order: "clear", name })));
    }
    const driven = driving.name === name;
    row.append(button(driven ? "Let go" : "Drive by hand", () => void this.#takeByHand(driven ? "" : name), driven));
    return row;
  }

  /** @param {string} name  empty to let go. */
  async #takeByHand(name) {
    this.driving.take("");
    if (name && !(await this.#runs(name, HAND))) return;
    if (name && this.arena.selected !== name) return; // another one was chosen meanwhile
    this.driving.take(name);
    this.update();
  }

  /**
   * @param {string} key
   * @param {string} words
   */
  #say(key, words) {
    const where = this.#figures[key];
    if (where !== undefined) say(where, words);
  }
}
