/** Buttons and keys of a replay: play, step, speed, infractions, camera. One set may drive several views in lockstep. */

import { h, s } from "../dom.js";
import { seconds } from "../format.js";
import { copyText } from "../table.js";
import { infractionText } from "../words.js";
import { CameraControls, isForPage } from "./camera_controls.js";
import { RATES } from "./clock.js";

const ICONS = {
  play: "M5 3 13 8 5 13z",
  pause: "M4 3h3v10h-3zM9 3h3v10h-3z",
  back: "M11 3 4 8 11 13z",
  forth: "M5 3 12 8 5 13z",
  previous: "M4 3h1.8v10h-1.8zM13 3 6 8 13 13z",
  next: "M10.2 3h1.8v10h-1.8zM3 3 10 8 3 13z",
};

export class Controls {
  /**
   * @param {import("./clock.js").Clock} clock
   * @param {import("./view.js").View[]} views
   * @param {() => string} link returns the address of the current view
   * @param {AbortSignal} [signal] after which keys do nothing here
   */
  constructor(clock, views, link, signal) {
    this.clock = clock;
    this.views = views;
    this.link = link;
    this.names = views[0].drive.names;
    const { whole, mark } = this.names;
    this.time = h("span", { class: "clock number" });
    this.said = h("p", { class: "sr", role: "status" });
    this.playButton = this._button("play", "play (space)", () => clock.toggle());
    this.rate = h(
      "select",
      { "aria-label": "speed", change: () => clock.setRate(Number(this.rate.value)) },
      RATES.map((rate) => h("option", { value: rate, selected: rate === 1 }, `${rate}×`)),
    );
    this.cameras = new CameraControls(views, whole, () => clock.request());
    this.copyButton = h("button", { type: "button", click: () => this._copy() }, "copy link");
    this.element = h(
      "div",
      { class: "controls", role: "toolbar", "aria-label": "Replay" },
      h(
        "div",
        { class: "group" },
        this._button("previous", `previous ${mark} (Shift i)`, () => this.jump(-1)),
        this._button("back", "one tick back (left)", () => clock.step(-1)),
        this.playButton,
        this._button("forth", "one tick forward (right)", () => clock.step(1)),
        this._button("next", `next ${mark} (i)`, () => this.jump(1)),
      ),
      this.time,
      this.rate,
      this.cameras.element,
      this.copyButton,
      this.said,
    );
    this._shown = "";
    clock.onFrame((time_s) => this._showTime(time_s));
    clock.onChange(() => this._showState());
    document.addEventListener("keydown", (event) => this._key(event), { signal });
  }

  /** Goes to the next infraction (1) or the one before (-1), of any view. */
  jump(direction) {
    const all = this.views.flatMap((view) => view.infractions).sort((a, b) => a.time_s - b.time_s);
    const now = this.clock.time;
    const found =
      direction > 0 ? all.find((one) => one.time_s > now + 0.04) : all.findLast((one) => one.time_s < now - 0.04);
    this.clock.pause();
    if (!found) {
      this.said.textContent = `no ${direction > 0 ? "later" : "earlier"} ${this.names.mark}`;
      return;
    }
    this.clock.seek(found.time_s);
    this.said.textContent = infractionText(found);
  }

  async _copy() {
    await copyText(new URL(this.link(), location.href).href);
    this.copyButton.textContent = "copied";
    setTimeout(() => (this.copyButton.textContent = "copy link"), 1500);
  }

  _button(icon, title, click) {
    return h(
      "button",
      { type: "button", class: "icon", title, "aria-label": title.replace(/ \(.*/, ""), click },
      picture(icon),
    );
  }

  _showTime(time_s) {
    const text = `${seconds(time_s)} / ${seconds(this.clock.duration)} s`;
    if (text === this._shown) return;
    this._shown = text;
    this.time.textContent = text;
  }

  _showState() {
    const name = this.clock.playing ? "pause" : "play";
    if (this.playButton.dataset.shows === name) return;
    this.playButton.dataset.shows = name;
    this.playButton.replaceChildren(picture(name));
    this.playButton.setAttribute("aria-label", name);
    this.playButton.title = `${name} (space)`;
  }

  _key(event) {
    if (!isForPage(event)) return;
    const second = Math.round(1 / this.clock.dt);
    const act = {
      " ": () => this.clock.toggle(),
      ArrowRight: () => this.clock.step(event.shiftKey ? second : 1),
      ArrowLeft: () => this.clock.step(event.shiftKey ? -second : -1),
      i: () => this.jump(1),
      I: () => this.jump(-1),
      ...this.cameras.keys,
      "<": () => this._faster(-1),
      ">": () => this._faster(1),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  _faster(direction) {
    const place = RATES.indexOf(this.clock.rate) + direction;
    if (place < 0 || place >= RATES.length) return;
    this.clock.setRate(RATES[place]);
    this.rate.value = String(RATES[place]);
  }
}

function picture(name) {
  return s("svg", { viewBox: "0 0 16 16", "aria-hidden": "true" }, s("path", { d: ICONS[name] }));
}
