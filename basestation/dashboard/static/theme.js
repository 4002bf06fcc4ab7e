/** Light or dark: as the system is, unless somebody chose here. */

const KEY = "muro-theme";
/** @type {("auto" | "light" | "dark")[]} */
const CHOICES = ["auto", "light", "dark"];

export class Theme {
  #choice = CHOICES.find((one) => one === localStorage.getItem(KEY)) ?? "auto";
  #dark = matchMedia("(prefers-color-scheme: dark)");

  /**
   * @param {HTMLElement} button
   * @param {() => void} changed
   */
  constructor(button, changed) {
    this.button = button;
    button.onclick = () => {
      this.#choice = CHOICES[(CHOICES.indexOf(this.#choice) + 1) % CHOICES.length] ?? "auto";
      localStorage.setItem(KEY, this.#choice);
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
