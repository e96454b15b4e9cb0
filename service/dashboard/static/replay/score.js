/** The score of a drive, explained: the formula with its numbers, factor by factor. */

import { h } from "../dom.js";
import { number } from "../format.js";
import { scoreOf } from "../scores.js";
import { label } from "../words.js";

/** @param ego of the replay @param {string} rules of the driving score */
export function explain(ego, rules = "2.0") {
  const { rc, ip, ds, irs } = ego.score;
  const outside = ego.score.outside ?? 0;
  const terms = [["RC", number(rc), "route completion, %"]];
  if (outside > 0) terms.push(["lanes", number(1 - outside), "1 less the metres outside the lanes per metre of route completed"]);
  const counted = ego.infractions.filter((one) => one.factor < 1); // factor 1: these rules do not count the kind
  const signs = rules === "2.1" ? costs(counted) : factors(counted);
  return h(
    "div",
    { class: "why" },
    h(
      "p",
      { class: "formula number" },
      [...terms, ...signs].map(([name, text, title], i) => [
        i ? " × " : "",
        h("span", { title: `${name}: ${title}` }, text),
      ]),
      " = ",
      h("b", {}, number(ds)),
    ),
    h(
      "dl",
      {},
      [...terms, ...signs].map(([name, text, title]) =>
        h(
          "div",
          {},
          h("dt", {}, h("span", {}, name), h("span", { class: "quiet" }, title)),
          h("dd", { class: "number" }, text),
        ),
      ),
    ),
    h(
      "dl",
      { class: "totals" },
      [
        ["DS", "driving score, %", ds],
        ["IP", "infraction penalty", ip],
        ["IRS", "infraction rate score, %", irs],
      ]
        .filter(([, , value]) => value !== undefined)
        .map(([name, title, value]) =>
          h(
            "div",
            {},
            h("dt", {}, name, h("span", { class: "quiet" }, title)),
            h("dd", { class: "number" }, number(value)),
          ),
        ),
    ),
    h(
      "p",
      { class: "quiet small" },
      `Rules ${rules}. Metres outside the lanes count as a share of the route completed; an infraction that ends the drive lowers its route completion.`,
    ),
  );
}

/** nuPlan's closed-loop score: the product of four factors times a weighted mean of four terms, all in percent. */
export function explainClosedLoop(terms) {
  const must = ["no_collision", "drivable_area", "driving_direction", "making_progress"].map(scoreOf);
  const mean = [
    [scoreOf("progress"), 5],
    [scoreOf("time_to_collision"), 5],
    [scoreOf("speed_limit"), 4],
    [scoreOf("comfort"), 2],
  ];
  const row = ({ key, title }, note) =>
    h(
      "div",
      {},
      h("dt", {}, title, h("span", { class: "quiet" }, note)),
      h("dd", { class: "number" }, number(terms[key])),
    );
  return h(
    "div",
    { class: "why" },
    h(
      "p",
      { class: "formula number" },
      must.map(({ key, title }) => [h("span", { title }, number(terms[key] / 100)), " × "]),
      h(
        "span",
        { title: "(5 EP + 5 TTC + 4 SL + 2 C) / 16" },
        number(mean.reduce((sum, [{ key }, weight]) => sum + (weight * terms[key]) / 16, 0)),
      ),
      " = ",
      h("b", {}, number(terms.closed_loop)),
    ),
    h("dl", {}, must.map((one) => row(one, "factor, %")), mean.map(([one, weight]) => row(one, `weight ${weight}, %`))),
  );
}

/** One factor per kind, such as 0.6² for two infractions of a kind. */
function factors(infractions) {
  const kinds = new Map();
  for (const one of infractions) {
    const key = `${one.kind} ${one.factor}`;
    kinds.set(key, { one, count: (kinds.get(key)?.count ?? 0) + 1 });
  }
  return [...kinds.values()].map(({ one, count }) => [
    label(one.kind),
    count > 1 ? `${number(one.factor)}${power(count)}` : number(one.factor),
    count > 1 ? `${count} times, each × ${number(one.factor)}` : "infraction factor",
  ]);
}

/** Rules 2.1: 1 / (1 + sum of costs); a factor p corresponds to the cost 1 / p - 1. */
function costs(infractions) {
  if (!infractions.length) return [];
  const each = infractions.map((one) => 1 / one.factor - 1);
  return [
    ["infractions", `1 / (1 + ${each.map(number).join(" + ")})`, infractions.map((one) => label(one.kind)).join(", ")],
  ];
}

const power = (n) => [...String(n)].map((digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(digit)]).join("");
