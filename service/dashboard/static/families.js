/** Families of benchmarks: what their episodes are called, and by which score two runs are seen side by side. */

import { measure, measuredBy } from "./measured.js";
import { FORECAST, FREEWAY, scoreOf } from "./scores.js";

/**
 * `one` and `many`: what is counted; `scenario`: what two runs have in common; `mission`: what has a mean of its own, null
 * where all episodes are of one; `replays`: whether episodes have some.
 */
export const FAMILIES = {
  driving: { one: "drive", many: "drives", scenario: "scenario", mission: "mission", replays: true },
  parking: { one: "lot", many: "lots", scenario: "lot", mission: null, replays: true },
  freeway: { one: "morning", many: "mornings", scenario: "morning", mission: null, replays: false },
  forecasting: { one: "day", many: "days", scenario: "day", mission: "day", replays: false },
};

/** The family of a comparison. */
export function familyOf({ metric, evaluations }) {
  if (metric in FORECAST) return FAMILIES.forecasting;
  if (metric in FREEWAY) return FAMILIES.freeway;
  return "aligned" in evaluations[0].scores ? FAMILIES.parking : FAMILIES.driving;
}

const SHORT = { driving_score: "DS", closed_loop: "closed loop" };

/** The score of each side in a scenario: of drives the closed-loop score where it is the headline, else the driving score. */
export function sideScore(comparison) {
  const { metric } = comparison;
  const driven = familyOf(comparison) === FAMILIES.driving && metric !== "closed_loop";
  const score = scoreOf(driven ? "driving_score" : metric);
  const { key } = score;
  const ofEgo = (ego, kind) => (kind ? measure(ego, kind, key) : driven ? ego.ds : ego.closed_loop?.closed_loop);
  return {
    ...score,
    name: SHORT[key] ?? score.title,
    of: (scenario) => (driven ? scenario.driving_scores : scenario.values),
    ofEgos: (episode) => (episode.summary?.egos ?? []).map((ego) => ofEgo(ego, measuredBy(episode))).filter(Number.isFinite),
  };
}
