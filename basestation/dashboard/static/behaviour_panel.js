/** What robots are to do: a behaviour for one or all, with its parameters, which can be changed while it runs. */

import { element, say } from "./dom.js";
import { ParameterForm } from "./parameter_form.js";

export class BehaviourPanel {
  #made = "";
  /** @type {HTMLSelectElement} */
  #who = element("select", { name: "who" });
  /** @type {HTMLSelectElement} */
  #what = element("select", { name: "behaviour" });
  #summary = element("p", { className: "hint" });
  #state = element("p", { className: "hint" });
  #start = element("button", { type: "submit", className: "main", textContent: "Start" });
  #form;

  /**
   * @param {HTMLElement} panel
   * @param {import("./fleet.js").Fleet} fleet
   * @param {import("./orders.js").Orders} orders
   */
  constructor(panel, fleet, orders) {
    this.fleet = fleet;
    this.orders = orders;
    const fields = element("div", { className: "fields" });
    this.#form = new ParameterForm(fields, () => this.#isLive() && this.#give());
    this.#who.onchange = () => this.#showRunning();
    this.#what.onchange = () => this.#show();
    this.form = element(
      "form",
      {},
      element("h2", {}, "Behaviour"),
      element(
        "div",
        { className: "pair" },
        element("label", {}, "For", this.#who),
        element("label", {}, "Behaviour", this.#what),
      ),
      this.#summary,
      fields,
      element("div", { className: "bar" }, this.#state, this.#start),
    );
    this.form.onsubmit = (event) => {
      event.preventDefault();
      if (!this.#start.hidden) this.#give(); // Enter in a field has entered it already
    };
    panel.prepend(this.form);
  }

  /** Show what is new. */
  update() {
    const { hello, robots, maySteer } = this.fleet;
    if (hello === null) return;
    const made = `${[...robots.keys()]} ${Object.keys(hello.behaviours)} ${maySteer}`;
    if (made !== this.#made) {
      this.#made = made;
      this.#who.replaceChildren(
        element("option", { value: "" }, "all robots"),
        ...[...robots.keys()].map((name) => element("option", { value: name }, name)),
      );
      this.#what.replaceChildren(
        ...Object.keys(hello.behaviours).map((name) => element("option", { value: name }, name)),
      );
      this.#showRunning();
      this.#start.disabled = !maySteer;
    }
    if (this.#shown === "" && this.#running() !== "") this.#showRunning();
    if (this.#isRunning() && this.#values() !== this.#shownValues && !this.form.contains(document.activeElement)) {
      this.#show(); // somebody else has changed them
    }
    say(this.#state, maySteer ? this.#stateInWords() : "You may watch, and stop.");
    say(this.#start, this.#offer());
    this.#start.hidden = !this.#start.textContent;
    this.#start.className = this.#isRunning() ? "quiet" : "main";
  }

  #stateInWords() {
    const running = this.#running();
    if (running && !(running in (this.fleet.hello?.behaviours ?? {}))) return `Running ${running}, from elsewhere.`;
    if (!this.#isRunning()) return "";
    if (!this.#isLive()) return `Running with different parameters; here are those of ${this.#like()?.name}.`;
    const parameters = this.fleet.hello?.behaviours[this.#what.value]?.parameters ?? {};
    return Object.keys(parameters).length ? "Running: changes apply at once." : "Running.";
  }

  /** What the button does; nothing where the robots would pass it over, for they do what they do already. */
  #offer() {
    if (!this.#isRunning()) return `Start ${this.#what.value}`;
    if (!this.#isLive()) return "Give to all";
    return this.#robots().some(({ condition }) => condition === "failed") ? "Start anew" : "";
  }

  /** A robot that has the behaviour that is shown. */
  #like() {
    return this.#robots().find(({ details }) => details.behaviour === this.#what.value);
  }

  /** The parameters that are in force, in a text that changes with them. */
  #values() {
    return inText(this.#like());
  }

  #shownValues = "";

  /** What was running when the form was last filled. */
  #shown = "";

  /** Show the behaviour that the chosen robots have. */
  #showRunning() {
    this.#shown = this.#running();
    if (this.#shown && [...this.#what.options].some(({ value }) => value === this.#shown))
      this.#what.value = this.#shown;
    this.#show();
  }

  /** Show the parameters of the chosen behaviour. */
  #show() {
    const facts = this.fleet.hello?.behaviours[this.#what.value];
    if (facts === undefined) return;
    say(this.#summary, facts.summary);
    this.#shownValues = this.#values();
    this.#form.show(facts.parameters, this.#like()?.details.parameters ?? {});
    for (const field of this.form.querySelectorAll(".fields input, .fields select")) {
      if (field instanceof HTMLInputElement || field instanceof HTMLSelectElement)
        field.disabled = !this.fleet.maySteer;
    }
    this.update();
  }

  #robots() {
    const name = this.#who.value;
    return [...this.fleet.robots.values()].filter((robot) => name === "" || robot.name === name);
  }

  /** The behaviour of the chosen robots; empty when they have different ones. */
  #running() {
    const found = new Set(this.#robots().map(({ details }) => details.behaviour ?? ""));
    return found.size === 1 ? /** @type {string} */ ([...found][0]) : "";
  }

  #isRunning() {
    return this.#running() === this.#what.value;
  }

  /** Whether a change applies at once: not where it would level what the robots have of their own. */
  #isLive() {
    return this.#isRunning() && new Set(this.#robots().map(inText)).size === 1;
  }

  #give() {
    const parameters = this.#form.values();
    if (parameters === null) return void this.form.reportValidity();
    const [behaviour, name] = [this.#what.value, this.#who.value];
    const order = { order: "behaviour", behaviour, parameters, names: name ? [name] : [] };
    void this.orders.give(`${name || "All robots"}: ${behaviour}`, order);
  }
}

/** A robot's parameters, in a text that changes with them. @param {import("./fleet.js").Robot | undefined} robot */
function inText(robot) {
  return JSON.stringify(Object.entries(robot?.details.parameters ?? {}).sort());
}
