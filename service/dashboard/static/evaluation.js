/** Facts of an evaluation that several pages show. */

import { h } from "./dom.js";
import { SIGNS } from "./words.js";

const MEANS = {
  done: "success",
  failed: "infraction",
  lost: "infrastructure",
  cancelled: "infrastructure",
  running: "running",
  queued: "waiting",
};

/** Where an evaluation or an episode stands. */
export function standing(status) {
  const kind = MEANS[status] ?? "waiting";
  return h("span", { class: `status ${kind}` }, h("i", { "aria-hidden": "true" }, SIGNS[kind]), status);
}

/** A bar of what is done, running and lost. */
export function bar({ done, running, lost, total }, name) {
  const share = (n) => ({ "--share": `${total ? (100 * n) / total : 0}%` });
  return h(
    "div",
    {
      class: "bar",
      role: "progressbar",
      "aria-label": name,
      "aria-valuemin": 0,
      "aria-valuemax": total,
      "aria-valuenow": done + lost,
    },
    h("span", { class: "done", style: share(done) }),
    h("span", { class: "lost", style: share(lost) }),
    h("span", { class: "running", style: share(running) }),
  );
}
