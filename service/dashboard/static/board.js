/** A leaderboard: of a benchmark's open ranking, or of a phase of a challenge. */

import { get } from "./api.js";
import { h } from "./dom.js";
import { agentName, estimateCells, missing, scale, verdict, whisker } from "./estimate.js";
import { moment, number, softwareText } from "./format.js";
import { hasInfractions, scoreOf, shown } from "./scores.js";
import { label, words } from "./words.js";

const MOST = 500; // places, as many as the service answers at once

/**
 * Reads the first places of a board.
 * @param {URLSearchParams} asked the benchmark or the ranking
 */
export const readBoard = (asked) => get(`/v1/leaderboard?${new URLSearchParams([...asked, ["limit", MOST]])}`);

/** What a page says of the version of dohyo whose runs have ranks; nothing where all rows are of one. */
export function versionText(rows) {
  const ranked = rows.find((row) => row.rank !== null);
  const several = new Set(rows.map(softwareText)).size > 1;
  return !several || !ranked ? "" : `Ranks compare the runs driven with ${softwareText(ranked)}, since another version may simulate and judge otherwise. `;
}

/** What a page says of a board with more places than it shows. */
export const partText = ({ rows, total }) =>
  rows.length < total ? `Shown are the first ${rows.length} of ${total.toLocaleString("en")} places; the CSV has all. ` : "";

/** The columns of a board; `headline` is the score that ranks. */
export function columnsOf(rows, headline, colour, measures = 4) {
  const score = ({ key, title, top, unit }) => ({
    title,
    unit,
    key,
    css: "estimate",
    head: scale(0, top),
    cell: (row) =>
      h("div", { style: { "--agent": colour[row.agent] ?? "var(--accent)" } }, whisker(row.scores[key], top)),
    csv: (row) => estimateCells(key, row.scores[key]),
  });
  const measured = rows.length ? shown(rows[0].scores, measures, headline) : [scoreOf(headline)];
  return [
    {
      title: rows.some((row) => row.team) ? "team and agent" : "agent",
      key: "agent",
      sort: (row) => row.team ?? row.agent,
      cell: (row) => who(row, colour),
      csv: (row) => ({ rank: row.rank, team: row.team, agent: row.agent, version: row.version, track: row.track, dohyo: row.dohyo_versions.join(" ") }),
    },
    { title: "run by", key: "verified", css: "verified", choice: true, sort: by, cell: verified, csv: by },
    ...measured.map(score),
    hasInfractions(rows[0]?.scores ?? {}) && {
      title: "infractions",
      unit: "/km",
      css: "infraction-rates",
      sort: (row) => Object.values(row.per_km).reduce((sum, one) => sum + one, 0),
      cell: (row) => rates(row, rows),
      csv: (row) => row.per_km,
    },
    rows.some((row) => row.lost > 0) && { title: "lost", unit: "drives", numeric: true, cell: (row) => row.lost },
    {
      title: "vs above",
      cell: (row) =>
        row.above
          ? verdict(row.above, `A: ${row.agent}, B: the row above`, "better")
          : missing("no row above has the same drives by the same version of dohyo"),
      csv: (row) => ({ verdict: row.above?.verdict, probability: row.above?.probability }),
    },
    { title: "runs", numeric: true, cell: attempts, csv: (row) => ({ runs: row.runs, thrown_away: row.thrown_away }) },
    {
      title: "when",
      css: "when",
      cell: (row) =>
        h(
          "a",
          { href: `/evaluations/${encodeURIComponent(row.evaluation)}`, title: "the evaluation" },
          h("time", { datetime: row.finished }, moment(row.finished).slice(0, 10)),
        ),
      csv: (row) => row.finished,
    },
  ].filter(Boolean);
}

function who(row, colour) {
  const why = unranked(row);
  const facts = [`v${row.version}`, row.kind, row.track, `${row.seeds} ${row.seeds === 1 ? "seed" : "seeds"}`];
  return h(
    "div",
    { class: "ranked" },
    h("span", { class: "rank-number number", title: why && `no rank: ${why}` }, String(row.rank ?? "–")),
    h(
      "div",
      {},
      row.team && h("div", { class: "team" }, row.team),
      agentName(row.agent, colour[row.agent]),
      row.baseline && h("span", { class: "quiet small plain" }, " baseline"),
      why && row.unranked !== "baseline" && h("span", { class: "quiet small plain" }, ` no rank: ${why}`),
      h("div", { class: "quiet small plain" }, facts.join(" · ")),
    ),
  );
}

/** Why a row has no rank; null for one that has. */
const unranked = (row) =>
  ({
    other_version: `driven with ${softwareText(row)}`,
    lost_too_many: "lost more than a tenth of its drives",
    low_throughput: "too few vehicles passed the bottleneck",
    baseline: "a baseline",
  })[row.unranked] ?? null;

const by = (row) => (row.verified ? "service" : "remote");

/** Who ran the agent: the service itself, or its owner, of whose machine nothing can be checked. */
function verified(row) {
  return row.verified
    ? h("span", { class: "status success", title: "the service itself ran this agent" }, h("i", { "aria-hidden": "true" }, "✓"), "service")
    : h("span", { class: "status quiet", title: "its owner ran this agent: computing time, memory and program cannot be checked" }, "remote");
}

/** Ordered runs, and the attempts at episodes that gave no record. */
function attempts(row) {
  return h(
    "span",
    { title: `${row.runs} ranked runs ordered; ${row.thrown_away} attempts at episodes gave no record` },
    String(row.runs),
    row.thrown_away > 0 && h("span", { class: "quiet" }, ` −${row.thrown_away}`),
  );
}

export const rate = (row, kind) => row.per_km[kind] ?? 0;

/** Kinds of infraction that happened on a board. */
export const kindsOn = (rows) => Object.keys(words.marks).filter((kind) => rows.some((one) => rate(one, kind) > 0));

/** One bar per kind of infraction on this board, on a scale that all rows share. */
function rates(row, rows) {
  const kinds = kindsOn(rows);
  const top = Math.max(...rows.flatMap((one) => kinds.map((kind) => rate(one, kind))), 1e-9);
  const total = kinds.reduce((sum, kind) => sum + rate(row, kind), 0);
  const text = kinds
    .filter((kind) => rate(row, kind) > 0)
    .map((kind) => `${label(kind)} ${number(rate(row, kind))}`)
    .join(", ");
  return h(
    "div",
    { class: "rates", title: text || "none" },
    h("b", { class: "number" }, number(total)),
    h(
      "span",
      { class: "spark", role: "img", "aria-label": `per km: ${text || "none"}` },
      kinds.map((kind) =>
        h("i", {
          class: rate(row, kind) ? null : "none",
          style: { height: `${Math.max(4, (100 * rate(row, kind)) / top)}%` },
        }),
      ),
    ),
  );
}
