/** What stands beside a replay: the choice of the ego, and why its score is what it is. */

import { fill, h, mark } from "../dom.js";
import { number, seconds } from "../format.js";
import { SIGNS, ending, fault, label, meaning, words } from "../words.js";
import { parked } from "./parked.js";
import { explain, explainClosedLoop } from "./score.js";

const LOST =
  "The traffic was gridlocked, which is not the agent's fault: the episode counts in no score, except means that count lost drives as 0.";

/** A choice of the ego, where there are several, and what is told of the chosen one. */
export function chosenEgo(replay, player, told) {
  const select = h(
    "select",
    { change: () => player.choose(select.value) },
    replay.egos.map((ego) => h("option", { value: ego.name }, ego.name)),
  );
  const facts = h("div", { class: "chosen" });
  player.onEgo = (ego) => {
    select.value = ego.name;
    fill(facts, told(ego));
  };
  player.onEgo(player.views[0].ego);
  return [replay.egos.length > 1 && h("p", {}, h("label", {}, replay.lot ? "kart " : "ego ", select)), facts];
}

/** Why an ego has its score: how its drive ended, the factors, and the infractions, each of which seeks its moment. */
export function why(ego, replay, player, closed = null) {
  const kind = meaning(ego.status);
  return [
    h("p", { class: `status large ${kind}` }, h("i", { "aria-hidden": "true" }, SIGNS[kind]), ending(ego.status)),
    ego.failure && h("p", { class: "reason" }, ego.failure),
    replay.egos.some((one) => one.status.startsWith("lost: ")) && h("p", { class: "reason" }, LOST),
    h("h2", {}, ego.parking ? "How it parked" : "Why this score"),
    ego.parking ? parked(ego) : closed ? explainClosedLoop(closed) : explain(ego, replay.rules),
    h("h2", {}, titleOf(ego)),
    h(
      "ol",
      { class: "infractions" },
      ego.infractions.map((one) =>
        h(
          "li",
          {},
          h(
            "button",
            { type: "button", class: "row", click: () => player.clock.seek(one.time_s) },
            mark(one.kind, words.marks[one.kind].path, one.at_fault === false),
            h("span", {}, h("b", {}, label(one.kind)), h("span", { class: "quiet detail" }, detail(one))),
            h("time", {}, `${seconds(one.time_s)} s`),
          ),
        ),
      ),
    ),
  ];
}

function titleOf(ego) {
  const what = ego.parking ? "contact" : "infraction";
  return ego.infractions.length ? `${what[0].toUpperCase()}${what.slice(1)}s (${ego.infractions.length})` : `No ${what}`;
}

const detail = (one) =>
  [one.magnitude ? `${number(one.magnitude)} ${one.unit}` : "", one.actor ?? "", fault(one)].filter(Boolean).join(" · ");
