/** The status of a world, with its sign. */

import { h } from "../dom.js";
import { SIGNS } from "../words.js";

const SIGN = { ...SIGNS, paused: "‖" };
const MEANS = { running: "running", paused: "paused", over: "success", done: "success", ended: "infrastructure", failed: "infraction" };

export function standing(status, size = "") {
  const kind = MEANS[status] ?? "waiting";
  return h("span", { class: `status ${size} ${kind}` }, h("i", { "aria-hidden": "true" }, SIGN[kind]), status);
}
