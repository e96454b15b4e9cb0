/** The timeline of a drive: a slider with the infractions on it, and one plot per measured quantity. */

import { h, mark, s } from "../dom.js";
import { number, seconds } from "../format.js";
import { label, words } from "../words.js";

const STRIPS = [
  { key: "speed", title: "speed", unit: "m/s", floor: 0 },
  { key: "acceleration", title: "acceleration", unit: "m/s²", zero: true },
  { key: "steering", title: "steering", unit: "rad", zero: true },
  { key: "lateral", title: "from route", unit: "m", zero: true },
];

export class Timeline {
  /** @param ego of the replay @param {import("./clock.js").Clock} clock */
  constructor(ego, clock) {
    this.clock = clock;
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
    this.cursors = [];
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
    const share = this.clock.duration ? time_s / this.clock.duration : 0;
    for (const cursor of this.cursors)
      cursor.style.setProperty("transform", `translateX(${(share * cursor.parentElement.clientWidth).toFixed(1)}px)`);
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

  _markRow() {
    const marks = this.ego.infractions.map((one) =>
      h(
        "button",
        {
          type: "button",
          class: "moment",
          tabindex: -1,
          title: `${label(one.kind)} at ${seconds(one.time_s)} s`,
          style: { left: `${(100 * one.time_s) / Math.max(this.clock.duration, 0.1)}%` },
          click: () => this.clock.seek(one.time_s),
        },
        mark(one.kind, words.marks[one.kind].path, one.at_fault === false),
      ),
    );
    return h(
      "div",
      { class: "strip top" },
      h("span", { class: "strip-title" }, "infractions"),
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
    const points = values.map((value, i) => `${i + this.first} ${(100 - (100 * (value - low)) / reach).toFixed(1)}`);
    const cursor = h("div", { class: "cursor" });
    const node = h("b", {}, "");
    this.cursors.push(cursor);
    this.values.push({ node, values });
    const plot = h(
      "div",
      { class: "plot" },
      s(
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
      ),
      cursor,
    );
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
      this.clock.seek(((event.clientX - box.left) / box.width) * this.clock.duration);
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
