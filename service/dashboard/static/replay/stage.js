/** The frame of a canvas seen from above: the canvas, its scale bar, and notes. */

import { h } from "../dom.js";

/**
 * A canvas with its scale bar.
 * @param map the roads, or why they are missing
 * @param {string} label says what the canvas shows
 * @param {Node} [title]
 */
export function stage(map, label, title) {
  const canvas = h("canvas", { class: "stage", tabindex: 0, role: "img", "aria-label": label });
  const line = h("span", {});
  const measure = h("div", { class: "ruler", "aria-hidden": "true" }, line);
  const ended = h("p", { class: "note ended", hidden: true }, "ended");
  const element = h(
    "figure",
    { class: "stage-frame" },
    title && h("figcaption", {}, title),
    h(
      "div",
      { class: "ground" },
      canvas,
      measure,
      ended,
      map.missing && h("p", { class: "note bare" }, `The roads are missing: ${map.missing}`),
    ),
  );
  return { element, canvas, ended, ruler: { box: measure, line, scale: 0 } };
}

/** Sets the scale bar to a round number of metres, about 100 px long. */
export function ruler(bar, camera) {
  if (bar.scale === camera.scale) return;
  bar.scale = camera.scale;
  const rough = 100 / camera.scale;
  const unit = 10 ** Math.floor(Math.log10(rough));
  const metres = unit * [5, 2, 1].find((one) => one * unit <= rough);
  bar.box.style.setProperty("width", `${(metres * camera.scale).toFixed(0)}px`);
  bar.line.textContent = `${metres} m`;
}
