/** The plots of the last minutes: which robots, live or frozen, with the values under the pointer. */

import { element } from "./dom.js";
import { FONT } from "./floor_layer.js";
import { uPlot } from "./vendor.js";
import { clock, figure as figureOf } from "./words.js";

/** @typedef {import("./history.js").Quantity} Quantity */
/** @typedef {import("uplot")} UPlot */

/**
 * @typedef {object} Chart
 * @property {string} title
 * @property {string} unit
 * @property {number} digits
 * @property {Quantity[]} quantities  the first is drawn solid, the second dashed.
 * @property {number} least  a range that is always shown: what is smaller than this is noise.
 */

/** @type {Chart[]} */
const CHARTS = [
  { title: "Spacing error", unit: "°", digits: 1, quantities: ["spacing"], least: 10 },
  { title: "Distance from the circle", unit: "m", digits: 3, quantities: ["distance"], least: 0.05 },
  { title: "Speed / commanded (dashed)", unit: "m/s", digits: 2, quantities: ["speed", "command"], least: 0.1 },
  { title: "Age of the pose", unit: "ms", digits: 0, quantities: ["age"], least: 50 },
  { title: "Pose to command", unit: "ms", digits: 1, quantities: ["latency"], least: 5 },
];

const HEIGHT = 140;

/** So many robots are read on a line under the title, of this height [em]: with one value each, or with more. */
const ON_A_LINE = [4, 3];
const LINE_HEIGHT = 1.5;

/** More lines than colours cannot be told apart. */
const MOST = 6;

export class Plots {
  /** The robots that are shown. @type {string[]} */
  #chosen = [];
  /** What the plots were made for. */
  #made = "";
  /** @type {UPlot[]} */
  #plots = [];
  /** @type {HTMLElement} */
  #charts;
  /** @type {HTMLElement} */
  #picker;

  /**
   * @param {HTMLElement} panel
   * @param {import("./fleet.js").Fleet} fleet
   * @param {import("./history.js").History} history
   * @param {import("./palette.js").Palette} palette
   */
  constructor(panel, fleet, history, palette) {
    this.panel = panel;
    this.fleet = fleet;
    /** What is shown: the history itself, or as it was when it was frozen. */
    this.history = history;
    this.palette = palette;
    const freeze = element("button", {
      type: "button",
      className: "quiet",
      textContent: "Freeze",
      ariaPressed: "false",
    });
    freeze.style.minWidth = "6.5em"; // for either text: nothing moves when it is pressed
    freeze.onclick = () => {
      const frozen = this.history === history;
      this.history = frozen ? history.copy() : history;
      freeze.textContent = frozen ? "Unfreeze" : "Freeze";
      freeze.ariaPressed = String(frozen);
      this.update();
    };
    this.#picker = element("fieldset", { className: "picker" });
    this.#charts = element("div", { className: "charts" });
    panel.append(element("div", { className: "bar" }, this.#picker, freeze), this.#charts);
    new ResizeObserver(() => this.update()).observe(this.#charts);
  }

  /** Draw what is new; nothing while nobody can see it. */
  update() {
    if (this.panel.hidden || this.#charts.clientWidth === 0 || uPlot === null) return;
    this.#offer();
    const made = `${this.#chosen} ${this.#charts.clientWidth} ${this.palette.ink}`;
    if (made !== this.#made) {
      this.#made = made;
      this.#make();
    }
    CHARTS.forEach(({ quantities }, index) => {
      const lines = this.#chosen.flatMap((name) => quantities.map((quantity) => this.history.of(name, quantity)));
      const plot = this.#plots[index];
      const figure = /** @type {HTMLElement | null | undefined} */ (plot?.root.parentElement);
      if (plot === undefined || !figure) return;
      // A quantity that nobody has now, such as spacing without a circle, takes no room.
      figure.hidden = lines.every((line) => line.every((value) => value === null));
      if (!figure.hidden) plot.setData([this.history.times, ...lines]);
    });
  }

  /** The robots to choose from. */
  #offer() {
    const names = [...this.fleet.robots.keys()];
    if (this.#picker.dataset.of === names.join()) return;
    this.#picker.dataset.of = names.join();
    this.#chosen = names.slice(0, MOST);
    this.#picker.replaceChildren(element("legend", { className: "away" }, "Robots in the plots"));
    for (const name of names) {
      const box = element("input", { type: "checkbox", checked: this.#chosen.includes(name) });
      const label = element("label", {}, box, name);
      box.onchange = () => {
        const chosen = this.#chosen.filter((other) => other !== name);
        if (box.checked) chosen.push(name);
        // The one that was chosen first makes room.
        this.#chosen = chosen.slice(-MOST);
        this.#tick();
        this.update();
      };
      this.#picker.append(label);
    }
    this.#tick();
  }

  /** Show in which colour each chosen robot is drawn. */
  #tick() {
    for (const label of this.#picker.querySelectorAll("label")) {
      const index = this.#chosen.indexOf(label.textContent ?? "");
      const box = label.querySelector("input");
      if (box !== null) box.checked = index >= 0;
      label.dataset.series = index >= 0 ? String(index + 1) : "";
    }
  }

  #make() {
    if (uPlot === null) return;
    for (const plot of this.#plots) plot.destroy();
    this.#charts.replaceChildren();
    this.#plots = CHARTS.map((chart) => this.#chart(chart));
  }

  /**
   * @param {Chart} chart
   * @returns {UPlot}
   */
  #chart({ title, unit, digits, quantities, least }) {
    const { palette } = this;
    // Its lines are there before there is anything to read: a chart must not move away from under the pointer.
    const lines = Math.ceil(this.#chosen.length / (ON_A_LINE[quantities.length > 1 ? 1 : 0] ?? 1));
    const readout = element("span", { className: "readout" });
    readout.style.height = `${LINE_HEIGHT * lines}em`;
    const time = element("time", {});
    const caption = element("figcaption", {}, element("span", {}, `${title} [${unit}]`), time, readout);
    const figure = element("figure", {}, caption);
    this.#charts.append(figure);
    const axis = {
      stroke: palette.muted,
      grid: { stroke: palette.line, width: 1 },
      ticks: { show: false },
      font: `11px ${FONT}`,
    };
    const series = this.#chosen.flatMap((name, index) =>
      quantities.map((_, second) => ({
        label: name,
        stroke: palette.series[index % palette.series.length] ?? palette.ink,
        width: 1.5,
        ...(second ? { dash: [4, 3] } : {}),
        points: { show: false },
        spanGaps: false,
      })),
    );
    const Made = /** @type {NonNullable<typeof uPlot>} */ (uPlot);
    return new Made(
      {
        width: this.#charts.clientWidth,
        height: HEIGHT,
        legend: { show: false },
        cursor: { sync: { key: "muro" }, points: { size: 6 }, drag: { x: false, y: false } },
        scales: {
          x: { time: true },
          y: { range: (_, low, high) => widened(low, high, least) },
        },
        axes: [
          { ...axis, size: 22, gap: 2, space: 90, values: (_, times) => times.map(clock) },
          { ...axis, size: 44, gap: 4, space: 28 },
        ],
        series: [{}, ...series],
        hooks: {
          setCursor: [
            (plot) => {
              const at = plot.cursor.idx;
              readout.replaceChildren();
              const t = at === null || at === undefined ? undefined : plot.data[0][at];
              time.textContent = t === undefined ? "" : clock(t);
              if (at === null || at === undefined) return;
              this.#chosen.forEach((name, index) => {
                const values = quantities.map((_, second) => plot.data[1 + index * quantities.length + second]?.[at]);
                if (values.every((value) => typeof value !== "number")) return;
                const item = element(
                  "span",
                  {},
                  `${name} ${values.map((value) => figureOf(value, digits)).join(" / ")}`,
                );
                item.dataset.series = String(index + 1);
                readout.append(item);
              });
            },
          ],
        },
      },
      [this.history.times, ...series.map(() => this.history.times.map(() => null))],
      figure,
    );
  }
}

/**
 * A range that shows no noise as if it were something.
 *
 * @param {number | null} low
 * @param {number | null} high
 * @param {number} least
 * @returns {[number, number]}
 */
function widened(low, high, least) {
  if (low === null || high === null) return [0, least];
  const missing = Math.max(0, least - (high - low)) / 2 + 0.06 * (high - low);
  return [low >= 0 ? Math.max(0, low - missing) : low - missing, high + missing];
}
