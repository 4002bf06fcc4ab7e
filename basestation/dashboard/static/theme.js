/** Light or dark: as the system is, unless somebody chose here. */

const KEY = "muro-theme";
/** @type {("auto" | "light" | "dark")[]} */
const CHOICES = ["auto", "light", "dark"];

/** What was chosen here before; a browser may keep nothing, and says so by an exception. */
function kept() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

/** @param {string} choice */
function keep(choice) {
  try {
    localStorage.setItem(KEY, choice);
  } catch {
    // It lasts as long as the page.
  }
}

export class Theme {
  #choice = CHOICES.find((one) => one === kept()) ?? "auto";
  #dark = matchMedia("(prefers-color-scheme: dark)");

  /**
   * @param {HTMLElement} button
   * @param {() => void} changed
   */
  constructor(button, changed) {
    this.button = button;
    button.onclick = () => {
      this.#choice = CHOICES[(CHOICES.indexOf(this.#choice) + 1) % CHOICES.length] ?? "auto";
      keep(this.#choice);
      this.#apply();
      changed();
    };
    this.#dark.addEventListener("change", () => {
      this.#apply();
      changed();
    });
    this.#apply();
  }

  #apply() {
    const dark = this.#choice === "dark" || (this.#choice === "auto" && this.#dark.matches);
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    this.button.ariaLabel = this.button.title = `Colours: ${this.#choice}`;
  }
}
