/** Episodes without a drive: days of forecasts and freeway mornings, which have measures alone. */

import { h } from "./dom.js";
import { missing } from "./estimate.js";
import { number, short } from "./format.js";
import { FORECAST, FREEWAY, scoreOf } from "./scores.js";

const KINDS = {
  day: { facts: "forecast", keys: Object.keys(FORECAST), heading: "Days, largest error first" },
  morning: { facts: "morning", keys: Object.keys(FREEWAY), heading: "Mornings, largest spread of speeds first" },
};

/** What the episodes of an evaluation are measured by; null of drives and lots. */
export const measuredBy = (episode) => KINDS[episode?.cell] ?? null;

/** A measure of an agent; squares are stored of measures that are roots. */
export function measure(ego, { facts }, key) {
  const value = ego?.[facts]?.[key];
  return value === undefined || value === null ? null : key.startsWith("rmse") ? Math.sqrt(value) : value;
}

/** The measure by which episodes are sorted, the worst first. */
export const worstFirst = (ego, kind) => -(measure(ego, kind, kind.keys[0]) ?? Infinity);

/** A column for each measure. */
export const measureColumns = (kind) =>
  kind.keys.map((key) => {
    const { title, unit } = scoreOf(key);
    const value = (row) => measure(row.ego, kind, key);
    return {
      title,
      unit,
      numeric: true,
      sort: (row) => value(row) ?? -1,
      cell: (row) => (value(row) === null ? missing("the agent failed, or the episode has not ended") : number(value(row))),
      csv: (row) => ({ [key]: value(row) }),
    };
  });

/** What the page of an episode shows in place of a replay. */
export function measuredEpisode(episode) {
  const kind = measuredBy(episode);
  const ego = episode.summary?.egos[0];
  return h(
    "section",
    {},
    ego?.failure && h("p", { class: "problem" }, ego.failure),
    h(
      "dl",
      { class: "tiles" },
      kind.keys.map((key) => {
        const { title, unit } = scoreOf(key);
        const value = measure(ego, kind, key);
        return h("div", {}, h("dt", {}, title, h("span", { class: "unit" }, ` ${unit}`)), h("dd", {}, value === null ? "—" : number(value)));
      }),
    ),
    h(
      "p",
      { class: "links" },
      h("a", { href: `/v1/episodes/${encodeURIComponent(episode.id)}/record` }, "record"),
      h("span", { class: "quiet" }, " · record hash ", h("code", { title: episode.record_hash }, short(episode.record_hash))),
    ),
  );
}
