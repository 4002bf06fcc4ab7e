/** The colours of the canvas, which are those of colours.css, light or dark. */

/** @typedef {import("./protocol.js").Condition} Condition */

/** Colours of robots in plots: Okabe and Ito's, which colour-blind people can tell apart, without yellow and black. */
const SERIES = ["--series-1", "--series-2", "--series-3", "--series-4", "--series-5", "--series-6"];

export class Palette {
  ink = "";
  muted = "";
  faint = "";
  line = "";
  floor = "";
  rim = "";
  surface = "";
  accent = "";
  importance = "";
  /** @type {Record<Condition, string>} */
  robots = { driving: "", holding: "", stopped: "", failed: "", stale: "", lost: "", unseen: "", absent: "" };
  /** @type {string[]} */
  series = [];

  constructor() {
    this.read();
  }

  /** Read the colours again, after the theme has changed. */
  read() {
    const style = getComputedStyle(document.documentElement);
    /** @param {string} name */
    const colour = (name) => style.getPropertyValue(name).trim();
    this.ink = colour("--ink");
    this.muted = colour("--muted");
    this.faint = colour("--faint");
    this.line = colour("--line");
    this.floor = colour("--floor");
    this.rim = colour("--rim");
    this.surface = colour("--surface");
    this.accent = colour("--accent");
    this.importance = colour("--importance");
    for (const condition of /** @type {Condition[]} */ (Object.keys(this.robots))) {
      this.robots[condition] = colour(`--${condition}`);
    }
    this.series = SERIES.map(colour);
  }
}
