/** Cross-play of a benchmark: a matrix of the agents that met in mixed runs. */

import { get } from "./api.js";
import { command } from "./command.js";
import { h } from "./dom.js";
import { agentName, estimateCells, scale, whisker } from "./estimate.js";
import { interval, number } from "./format.js";
import { unread } from "./notice.js";
import { scoreOf } from "./scores.js";
import { colours } from "./subject.js";
import { copyButton, table } from "./table.js";

/**
 * The section of a board's page.
 * @param {string} benchmark name of a benchmark whose egos drive together
 * @param {string[]} egos their names
 * @param {string} version content hash of the benchmark
 */
export async function crossPlay(benchmark, egos, version) {
  const path = `/v1/benchmarks/${encodeURIComponent(benchmark)}/cross-play?version=${encodeURIComponent(version)}`;
  const document = await get(path).catch((failure) => ({ failure }));
  const content = document.failure
    ? unread("Cross-play", document.failure)
    : document.agents.length
      ? await matrix(document, path)
      : empty(benchmark, egos, document.other_versions);
  return h("section", { class: "cross-play", "aria-label": "Cross-play" }, content);
}

async function matrix(document, path) {
  const { agents, cells, metric } = document;
  const colour = await colours(agents.map((one) => one.agent));
  const score = scoreOf(metric);
  const met = new Map(cells.map((one) => [`${one.submission} ${one.other}`, one]));
  const columns = [
    {
      title: "agent",
      cell: (row) => [agentName(row.agent, colour[row.agent]), h("div", { class: "quiet small plain" }, `v${row.version} · ${row.kind} · ${row.track}`)],
      csv: (row) => ({ agent: row.agent, version: row.version }),
    },
    {
      title: "with all others",
      css: "estimate",
      head: scale(0, score.top),
      cell: (row) => h("div", { style: { "--agent": colour[row.agent] ?? "var(--accent)" } }, whisker(row.score, score.top)),
      csv: (row) => estimateCells(metric, row.score),
    },
    ...agents.map((other) => {
      const find = (row) => met.get(`${row.submission} ${other.submission}`);
      const name = `with ${other.agent} v${other.version}`;
      return {
        title: name,
        css: "shaded named",
        cell: (row) => cell(find(row), row.submission === other.submission, score),
        sort: (row) => find(row)?.score.mean ?? -1,
        csv: (row) => ({ [name]: find(row)?.score.mean, [`${name} drives`]: find(row)?.drives ?? 0 }),
      };
    }),
  ];
  return [
    h(
      "div",
      { class: "heading" },
      h("h2", {}, "Cross-play", h("span", { class: "unit" }, ` ${score.title} ${score.unit}`)),
      copyButton(columns, agents),
    ),
    h("div", { class: "panel wide" }, table(columns, agents, { name: "cross", caption: `Cross-play of ${document.benchmark}` })),
    h(
      "p",
      { class: "note" },
      `The score of the row's agent over its drives in mixed runs with the column's agent: mean, 95 % interval, number of drives, and of those lost to gridlocks, which are in no mean; from ${document.runs} mixed ${document.runs === 1 ? "run" : "runs"}, the newest of each owner, at most 100${othersOf(document)}. `,
      "On the diagonal an agent drives all egos. Missions and seeds may differ between cells: the matrix shows, and does not rank.",
    ),
    h("p", { class: "links" }, h("a", { href: path }, "JSON")),
  ];
}

/** Runs that are left out, in words. */
function othersOf({ dohyo_version: dohyo, other_versions: others }) {
  return others ? `, all driven by dohyo ${dohyo}; ${others} of other versions do not count` : "";
}

/** A pair of agents: the higher the score, the stronger the shade. */
function cell(found, itself, { top }) {
  if (!found) return h("span", { class: "quiet small" }, itself ? "no run alone" : "not met");
  const { score, lost } = found;
  return h(
    "div",
    { class: "shade", style: { "--share": ((0.4 * Math.max(0, score.mean ?? 0)) / top).toFixed(3) } },
    h("b", { class: "number" }, number(score.mean)),
    itself && h("span", { class: "quiet" }, " alone"),
    h("div", { class: "quiet number" }, `${interval(score)} n=${score.n}${lost ? `, ${lost} lost` : ""}`),
  );
}

function empty(benchmark, egos, others) {
  const why = others ? `No mixed run of one version of dohyo yet, and ${others} of several.` : "No mixed run yet.";
  return [
    h("h2", {}, "Cross-play"),
    h("p", {}, `${why} This command drives one, in which two submitted agents meet:`),
    command(`dohyo evaluations start AGENT ${benchmark} --ego ${egos[0]}=OTHER --watch`),
  ];
}
