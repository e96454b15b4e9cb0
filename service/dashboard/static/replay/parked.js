/** How a kart ended, in its facts. */

import { h } from "../dom.js";
import { number } from "../format.js";

const ISO = "ISO 16787: within 3° and 0.2 m of the axis of its spot";

/** The facts of a kart's record as a list. */
export function parked({ parking: one }) {
  const facts = [
    ["parked", one.ending === "parked" ? "yes" : "no"],
    ["aligned", one.aligned ? "yes" : "no", ISO],
    ["time", `${number(one.time_s)} s`],
    ["angle to its spot", `${number(one.inclination_deg)}°`],
    ["beside the axis of its spot", `${number(one.deviation_m)} m`],
    ["from the centre of its spot", `${number(one.distance_m)} m`],
    ["touched", one.touched],
    ["driven", `${number(one.driven_m)} m`],
    ["changes of direction", String(one.shunts)],
  ];
  return h(
    "div",
    { class: "why" },
    h("dl", {}, facts.map(([name, value, note]) => h("div", {}, h("dt", {}, name, note && h("span", { class: "quiet" }, note)), h("dd", { class: "number" }, value)))),
  );
}
