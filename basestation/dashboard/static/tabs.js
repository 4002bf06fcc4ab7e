/** Tabs: one panel at a time, by mouse or by arrow keys. */

export class Tabs {
  /**
   * @param {HTMLElement} list  its buttons control a panel each.
   * @param {() => void} changed  called when another panel is shown.
   */
  constructor(list, changed) {
    this.list = list;
    this.changed = changed;
    for (const tab of this.#tabs()) tab.addEventListener("click", () => this.show(tab));
    list.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step === undefined) return;
      const tabs = this.#tabs().filter((tab) => !tab.hidden);
      const now = tabs.findIndex((tab) => tab.ariaSelected === "true");
      const next = tabs[(now + step + tabs.length) % tabs.length];
      if (next === undefined) return;
      event.preventDefault();
      this.show(next);
      next.focus();
    });
  }

  /** @param {HTMLElement} chosen */
  show(chosen) {
    for (const tab of this.#tabs()) {
      const mine = tab === chosen;
      tab.ariaSelected = String(mine);
      tab.tabIndex = mine ? 0 : -1;
      const panel = document.getElementById(tab.getAttribute("aria-controls") ?? "");
      if (panel !== null) panel.hidden = !mine;
    }
    this.changed();
  }

  /** @returns {HTMLElement[]} */
  #tabs() {
    return [...this.list.querySelectorAll("button")];
  }
}
