/** Breaking things, in a simulated fleet: what, where, for how long; and what was broken, as rows of a scenario. */

import { element, say } from "./dom.js";
import { ParameterForm } from "./parameter_form.js";

export class FaultsPanel {
  #made = "";
  #what = element("select", { name: "kind" });
  #where = element("select", { name: "target" });
  #duration = element("input", {
    type: "number",
    min: "0.1",
    step: "any",
    value: "5",
    name: "duration",
    inputMode: "decimal",
  });
  #right = element("p", { className: "hint" });
  #doc = element("p", { className: "hint" });
  #lasting = element("ul", { className: "lasting", ariaLabel: "Broken now" });
  #rows = element("pre", { tabIndex: 0 });
  #save = element("button", { type: "button", className: "quiet", textContent: "Save" });
  #numbers;

  /**
   * @param {HTMLElement} panel
   * @param {import("./fleet.js").Fleet} fleet
   * @param {import("./orders.js").Orders} orders
   */
  constructor(panel, fleet, orders) {
    this.fleet = fleet;
    this.orders = orders;
    const fields = element("div", { className: "fields" });
    this.#numbers = new ParameterForm(fields, () => {});
    this.#what.onchange = () => this.#show();
    this.form = element(
      "form",
      {},
      element("h2", {}, "Break it"),
      element(
        "div",
        { className: "pair" },
        element("label", {}, "What", this.#what),
        element("label", {}, "Where", this.#where),
      ),
      this.#doc,
      fields,
      element(
        "div",
        { className: "bar" },
        element("label", { className: "inline" }, "for [s]", this.#duration),
        this.#right,
        element("button", { type: "submit", className: "main", textContent: "Break it" }),
      ),
      this.#lasting,
    );
    this.form.onsubmit = (event) => {
      event.preventDefault();
      this.#break();
    };
    this.#save.onclick = () => this.#download();
    panel.append(
      this.form,
      element("div", { className: "bar" }, element("h2", {}, "For a scenario"), this.#save),
      this.#rows,
    );
  }

  /** Show what is new. */
  update() {
    const { hello, maySteer, faults } = this.fleet;
    const kinds = hello?.faults ?? {};
    const made = JSON.stringify([Object.entries(kinds).map(([kind, { targets }]) => [kind, targets]), maySteer]);
    if (made !== this.#made) {
      this.#made = made;
      const choices = Object.keys(kinds).map((kind) => element("option", { value: kind }, kind.replaceAll("_", " ")));
      this.#what.replaceChildren(...choices);
      this.#show();
      for (const field of this.form.elements) Reflect.set(field, "disabled", !maySteer);
      say(this.#right, maySteer ? "" : "You may watch, and stop.");
    }
    say(this.#rows, faults.rows || "Nothing was broken in this run.");
    this.#save.disabled = !faults.rows;
    const lasting = faults.lasting.join();
    if (this.#lasting.dataset.of === lasting) return;
    this.#lasting.dataset.of = lasting;
    this.#lasting.replaceChildren(...faults.lasting.map((words) => element("li", {}, words)));
  }

  #show() {
    const facts = this.fleet.hello?.faults?.[this.#what.value];
    if (facts === undefined) return;
    const before = this.#where.value;
    this.#where.replaceChildren(...facts.targets.map((target) => element("option", { value: target }, target)));
    if (facts.targets.includes(before)) this.#where.value = before;
    say(this.#doc, facts.doc);
    this.#numbers.show(facts.parameters, {});
  }

  #break() {
    const numbers = this.#numbers.values();
    if (numbers === null) return void this.form.reportValidity();
    const [kind, target] = [this.#what.value, this.#where.value];
    const duration = this.#duration.value === "" ? null : Number(this.#duration.value);
    const words = `Break ${target}: ${kind.replaceAll("_", " ")}`;
    void this.orders.give(words, { order: "break", kind, target, duration, numbers });
  }

  #download() {
    const address = URL.createObjectURL(new Blob([this.fleet.faults.rows], { type: "application/toml" }));
    element("a", { href: address, download: "faults.toml" }).click();
    setTimeout(() => URL.revokeObjectURL(address), 1000);
  }
}
