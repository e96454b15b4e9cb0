/** Buttons and keys of the cameras of one or several views: follow, whole route, zoom. */

import { h } from "../dom.js";

export class CameraControls {
  /**
   * @param {import("./view.js").View[]} views
   * @param {string} whole what the button that fits everything shows: "route" or "lot"
   * @param {() => void} redraw
   */
  constructor(views, whole, redraw) {
    this.views = views;
    this.redraw = redraw;
    this.followButton = h(
      "button",
      { type: "button", "aria-pressed": "true", title: "camera follows the ego (f)", click: () => this.follow() },
      "follow",
    );
    this.element = h(
      "div",
      { class: "group" },
      this.followButton,
      h("button", { type: "button", title: `whole ${whole} (0)`, click: () => this.whole() }, `whole ${whole}`),
      zoomButton("zoom out", "−", () => this.zoom(1 / 1.5)),
      zoomButton("zoom in", "+", () => this.zoom(1.5)),
    );
    this.keys = {
      f: () => this.follow(),
      0: () => this.whole(),
      "+": () => this.zoom(1.5),
      "=": () => this.zoom(1.5),
      "-": () => this.zoom(1 / 1.5),
    };
  }

  follow() {
    const free = this.views.some((view) => !view.camera.follow);
    this._each((camera) => (camera.follow = free));
  }

  whole() {
    for (const view of this.views) view.camera.fit(view.routeBounds());
    this._each(() => {});
  }

  zoom(factor) {
    this._each((camera) => camera.zoom(factor));
  }

  /** Shows whether the cameras follow. */
  show() {
    const follows = this.views.every((view) => view.camera.follow);
    this.followButton.setAttribute("aria-pressed", String(follows));
  }

  _each(change) {
    for (const view of this.views) {
      change(view.camera);
      view.canvas.classList.toggle("free", !view.camera.follow);
      view.onCamera();
    }
    this.redraw();
  }
}

function zoomButton(name, sign, click) {
  return h("button", { type: "button", "aria-label": name, title: `${name} (${sign})`, click }, sign);
}

/** Whether a key event is for the page, and not for a field or a browser's shortcut. */
export function isForPage(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return false;
  const on = event.target;
  if (on.matches("input:not(.scrub), textarea, select, [contenteditable]")) return false;
  return !(event.key === " " && on.closest("button, a, summary")); // space presses what has the focus
}
