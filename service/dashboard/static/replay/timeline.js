/** The timeline of a drive: a slider with the infractions on it, and one plot per measured quantity. */

import { h, mark, s } from "../dom.js";
import { number, seconds } from "../format.js";
import { infractionText, words } from "../words.js";

const STRIPS = [
  { key: "speed", title: "speed", unit: "m/s", floor: 0 },
  { key: "acceleration", title: "acceleration", unit: "m/s²", zero: true },
  { key: "steering", title: "steering", unit: "rad", zero: true },
  { key: "lateral", title: "from route", unit: "m", zero: true },
];

/** A choice of how much of the drive the plots show, s; null: all of it. Their values fill the height. */
export class Zoom {
  constructor(changed) {
    this.span_s = null;
    this.choice = h(
      "select",
      {
        change: () => {
          this.span_s = Number(this.choice.value) || null;
          changed();
        },
      },
      ["", 60, 20, 5].map((span) => h("option", { value: span }, span ? `${span} s around now` : "the whole drive")),
    );
    this.element = h("p", { class: "note zoom-choice" }, h("label", {}, "plots show ", this.choice));
  }
}

export class Timeline {
  /** @param ego of the replay @param {import("./clock.js").Clock} clock @param {Zoom} zoom @param {string} mark what its marks are */
  constructor(ego, clock, zoom, mark = "infraction") {
    this.mark = mark;
    this.clock = clock;
    this.zoom = zoom;
    this.ego = ego;
    this.first = ego.track?.first ?? 0;
    this.slider = h("input", {
      type: "range",
      class: "scrub",
      min: 0,
      max: clock.duration.toFixed(3),
      step: clock.dt,
      value: 0,
      "aria-label": "time, s",
      input: () => clock.seek(Number(this.slider.value)),
    });
    this.plots = [];
    this.values = [];
    this.element = h(
      "div",
      { class: "timeline" },
      this._markRow(),
      STRIPS.filter((strip) => ego.series[strip.key]).map((strip) => this._strip(strip)),
    );
    this._shown = -1;
  }

  /** Moves the cursor to a time; numbers change once per tick. */
  show(time_s) {
    const [from, to] = this._window(time_s);
    for (const plot of this.plots) this._showPart(plot, time_s, from, to);
    const tick = Math.floor(time_s / this.clock.dt + 1e-6);
    if (tick === this._shown) return;
    this._shown = tick;
    this.slider.value = time_s;
    this.slider.setAttribute("aria-valuetext", `${seconds(time_s)} s`);
    for (const { node, values } of this.values) {
      const value = values[tick - this.first];
      node.textContent = value === undefined || value === null ? "—" : value.toFixed(Math.abs(value) < 10 ? 2 : 1);
    }
  }

  /** First and last time that the plots show, s. */
  _window(time_s) {
    const { duration } = this.clock;
    const span = Math.min(this.zoom.span_s ?? duration, duration);
    const from = Math.min(Math.max(0, time_s - span / 2), duration - span);
    return [from, from + span];
  }

  /** Moves a plot's cursor, and where the window has changed its view box: the values in it fill the height. */
  _showPart(plot, time_s, from, to) {
    const share = to > from ? (time_s - from) / (to - from) : 0;
    plot.cursor.style.setProperty("transform", `translateX(${(share * plot.element.clientWidth).toFixed(1)}px)`);
    const [a, b] = [from, to].map((time) => Math.round(time / this.clock.dt));
    if (plot.from === a && plot.to === b) return;
    Object.assign(plot, { from: a, to: b });
    const whole = this.zoom.span_s === null;
    const seen = whole ? [] : plot.heights.slice(Math.max(0, a - this.first), Math.max(0, b - this.first + 1));
    const [[low], [high]] = seen.length ? extremes(seen) : [[0], [100]];
    const room = Math.max(0.06 * (high - low), 0.5);
    plot.svg.setAttribute("viewBox", `${a} ${low - room} ${Math.max(1, b - a)} ${high - low + 2 * room}`);
    plot.element.title = whole ? "" : `from ${number(plot.value(high))} to ${number(plot.value(low))} ${plot.unit}`;
  }

  _markRow() {
    const marks = this.ego.infractions.map((one) =>
      h(
        "button",
        {
          type: "button",
          class: "moment",
          tabindex: -1,
          title: infractionText(one),
          style: { left: `${(100 * one.time_s) / Math.max(this.clock.duration, 0.1)}%` },
          click: () => this.clock.seek(one.time_s),
        },
        mark(one.kind, words.marks[one.kind].path, one.at_fault === false),
      ),
    );
    return h(
      "div",
      { class: "strip top" },
      h("span", { class: "strip-title" }, `${this.mark}s`),
      h("div", { class: "plot scrubber" }, this.slider, h("div", { class: "moments" }, marks)),
      h("span", { class: "strip-value number" }, String(this.ego.infractions.length)),
    );
  }

  _strip({ key, title, unit, zero, floor }) {
    const values = this.ego.series[key];
    const finite = values.filter((value) => Number.isFinite(value));
    const low = Math.min(floor ?? Infinity, zero ? 0 : Infinity, ...extremes(finite)[0]);
    const high = Math.max(zero ? 0 : -Infinity, ...extremes(finite)[1]);
    const reach = Math.max(high - low, 1e-3);
    const total = Math.max(1, Math.round(this.clock.duration / this.clock.dt));
    const heights = values.map((value) => 100 - (100 * (value - low)) / reach);
    const points = heights.map((height, i) => `${i + this.first} ${height.toFixed(2)}`);
    const cursor = h("div", { class: "cursor" });
    const node = h("b", {}, "");
    this.values.push({ node, values });
    const svg = s(
        "svg",
        {
          viewBox: `0 -6 ${total} 112`,
          preserveAspectRatio: "none",
          role: "img",
          "aria-label": `${title}, ${unit}: from ${number(Math.min(...finite))} to ${number(Math.max(...finite))}`,
        },
        zero &&
          s("line", {
            class: "axis",
            x1: 0,
            x2: total,
            y1: 100 - (100 * -low) / reach,
            y2: 100 - (100 * -low) / reach,
          }),
        this.ego.infractions.map((one) =>
          s("line", { class: "when", x1: one.time_s / this.clock.dt, x2: one.time_s / this.clock.dt, y1: -6, y2: 106 }),
        ),
        s("polyline", { points: points.join(" ") }),
    );
    const plot = h("div", { class: "plot" }, svg, cursor);
    this.plots.push({ element: plot, svg, cursor, heights, unit, value: (height) => low + ((100 - height) / 100) * reach });
    this._scrubBy(plot);
    return h(
      "div",
      { class: "strip" },
      h("span", { class: "strip-title" }, title, h("span", { class: "unit" }, ` ${unit}`)),
      plot,
      h("span", { class: "strip-value number" }, node),
    );
  }

  /** Pressing or dragging on a plot moves the time there. */
  _scrubBy(plot) {
    const go = (event) => {
      const box = plot.getBoundingClientRect();
      const [from, to] = this._window(this.clock.time);
      this.clock.seek(from + ((event.clientX - box.left) / box.width) * (to - from));
    };
    plot.addEventListener("pointerdown", (event) => {
      plot.setPointerCapture(event.pointerId);
      go(event);
    });
    plot.addEventListener("pointermove", (event) => plot.hasPointerCapture(event.pointerId) && go(event));
  }
}

/** [[least], [greatest]], without a call that has one argument per value. */
function extremes(values) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low <= high ? [[low], [high]] : [[0], [0]];
}
