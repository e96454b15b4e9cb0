/** Facts of an evaluation that several pages show. */

import { h } from "./dom.js";
import { whisker } from "./estimate.js";
import { shown } from "./scores.js";
import { SIGNS } from "./words.js";

const MEANS = {
  done: "success",
  failed: "infraction",
  lost: "infrastructure",
  cancelled: "infrastructure",
  running: "running",
  queued: "waiting",
};

/** The status of an evaluation or an episode, with its sign. */
export function standing(status) {
  const kind = MEANS[status] ?? "waiting";
  return h("span", { class: `status ${kind}` }, h("i", { "aria-hidden": "true" }, SIGNS[kind]), status);
}

/** Whether an episode counts in no score: it has no record, or the traffic was gridlocked in it. */
export const isLost = (episode) =>
  episode.status === "lost" || (episode.summary?.egos ?? []).some((ego) => ego.status.startsWith("lost: "));

/** A progress bar: the shares of episodes that are done, lost and running. */
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

/** A panel with the scores of a summary, `headline` first; where drives were lost, also with the means that count them as 0. */
export function measures({ scores, scores_lost_as_zero: lostAsZero, lost }, most, headline = null) {
  return h(
    "div",
    { class: "panel measures" },
    shown(scores, most, headline).map(({ key, title, unit, top }) =>
      h(
        "div",
        {},
        h("h3", {}, title, h("span", { class: "unit" }, ` ${unit}`)),
        whisker(scores[key], top),
        lostAsZero && [
          h("p", { class: "note" }, `counting ${lost} lost ${lost === 1 ? "drive" : "drives"} as 0`),
          whisker(lostAsZero[key], top),
        ],
      ),
    ),
  );
}
