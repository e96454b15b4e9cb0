/** One agent: its scores, its score in each cell, its infractions beside the median of all agents, its evaluations. */

import { get, getAll, page } from "../api.js";
import { readBoard } from "../board.js";
import { byId, fill, h, mark } from "../dom.js";
import { missing, whisker } from "../estimate.js";
import { bar, measures, standing } from "../evaluation.js";
import { moment, number, short } from "../format.js";
import { agentsOf, isMixed } from "../mixed.js";
import { unread } from "../notice.js";
import { goodness, hasInfractions, scoreOf, shown } from "../scores.js";
import { colours, subject } from "../subject.js";
import { copyButton, table } from "../table.js";
import { overVersions } from "../versions.js";
import { label, words } from "../words.js";

const MOST_VERSIONS = 12;

page(async () => {
  const name = subject();
  const path = `/v1/agents/${encodeURIComponent(name)}`;
  const [agent, submissions, evaluations, colour] = await Promise.all([
    get(path),
    getAll(`${path}/submissions`).catch((failure) => ({ failure })),
    getAll(`/v1/evaluations?agent=${encodeURIComponent(name)}`),
    colours([name]),
  ]);
  evaluations.sort((a, b) => (a.created < b.created ? 1 : -1));
  const alone = evaluations.filter((one) => !isMixed(one));
  const latest = [
    ...new Map(
      alone
        .filter((one) => one.status === "done")
        .reverse()
        .map((one) => [one.benchmark, one]),
    ).values(),
  ];
  const parts = await Promise.all(latest.map((one) => benchmarkPart(one, alone)));
  byId("content").style.setProperty("--agent", colour[name] ?? "var(--accent)");
  fill(
    byId("content"),
    h(
      "div",
      { class: "title" },
      h("h1", { class: "agent" }, h("span", { class: "dot-agent big", "aria-hidden": "true" }), name),
      h("p", { class: "lead quiet" }, agent.description || "No description."),
      h(
        "p",
        { class: "byline quiet" },
        `by ${agent.owner}`,
        h("span", {}, `since ${moment(agent.created).slice(0, 10)}`),
      ),
    ),
    parts.length
      ? parts
      : h(
          "section",
          { class: "state" },
          h("h2", {}, "No finished evaluation yet"),
          h("p", {}, "Scores appear when the first evaluation has finished in which the agent drives all egos."),
        ),
    history(evaluations, name),
    versions(submissions),
  );
});

async function benchmarkPart(evaluation, evaluations) {
  const name = evaluation.benchmark;
  const [metrics, board] = await Promise.all([
    get(`/v1/evaluations/${encodeURIComponent(evaluation.id)}/metrics`).catch((failure) => ({ failure })),
    readBoard(new URLSearchParams({ benchmark: name })).catch((failure) => ({ rows: [], total: 0, failure })),
  ]);
  if (metrics.failure) return h("section", {}, unread(name, metrics.failure));
  const versions = await scoresByVersion(evaluation, evaluations).catch((failure) => ({ failure }));
  const whole = metrics.all;
  return h(
    "section",
    {},
    h(
      "div",
      { class: "heading" },
      h("h2", {}, name),
      h("a", { href: `/evaluations/${encodeURIComponent(evaluation.id)}` }, "latest evaluation"),
    ),
    measures(whole, 6),
    versions.failure && [h("h3", {}, `${headline(whole).title} over versions`), unread(null, versions.failure)],
    versions.length > 1 && overVersions(versions, headline(whole)),
    h("div", { class: "columns" }, hasInfractions(whole.scores) && infractionsPart(whole, board), cellsPart(Object.entries(metrics.cells), whole)),
  );
}

const headline = (summary) => shown(summary.scores, 1)[0];

/** The headline of the latest finished evaluation of each version on the same benchmark version, for the newest ones; without secret ones. */
async function scoresByVersion(evaluation, evaluations) {
  const same = evaluations.filter((one) => one.status === "done" && one.benchmark_version === evaluation.benchmark_version);
  const newest = new Map([...same].reverse().map((one) => [one.version, one])); // `evaluations` has the newest first
  const some = [...newest.values()].sort((a, b) => a.version - b.version).slice(-MOST_VERSIONS);
  const points = await Promise.all(
    some.map(async (one) => {
      const metrics = await get(`/v1/evaluations/${encodeURIComponent(one.id)}/metrics`).catch((error) => {
        if (error.status !== 403) throw error;
      });
      const estimate = metrics?.all.scores[headline(metrics.all).key];
      return { version: one.version, href: `/evaluations/${encodeURIComponent(one.id)}`, estimate };
    }),
  );
  return points.filter(({ estimate }) => typeof estimate?.mean === "number");
}

function infractionsPart(whole, { rows: field, total, failure }) {
  const others = field.length < total ? `the first ${field.length} agents` : "all agents";
  const rows = Object.keys(words.marks)
    .map((kind) => ({ kind, own: whole.per_km[kind], median: median(field.map((one) => one.per_km[kind] ?? 0)) }))
    .filter((row) => (row.own?.mean ?? 0) > 0 || (row.median ?? 0) > 0);
  const top = Math.max(...rows.map((row) => Math.max(row.own?.high ?? row.own?.mean ?? 0, row.median ?? 0)), 0.001);
  const columns = [
    {
      title: "kind",
      cell: (row) => h("span", { class: "with-mark" }, mark(row.kind, words.marks[row.kind].path), label(row.kind)),
      csv: (row) => row.kind,
    },
    { title: "per km", css: "estimate", cell: (row) => whisker(row.own, top), csv: (row) => row.own?.mean },
    !failure && { title: `median of ${others}`, numeric: true, cell: (row) => number(row.median), csv: (row) => row.median },
  ].filter(Boolean);
  return h(
    "div",
    {},
    h("div", { class: "heading sub" }, h("h3", {}, "Infractions per km"), rows.length > 0 && copyButton(columns, rows)),
    rows.length
      ? h("div", { class: "panel wide" }, table(columns, rows, { name: "infractions" }))
      : h("p", { class: "note" }, "No infraction in any drive."),
    failure && [h("h3", {}, "Median of all agents"), unread(null, failure)],
  );
}

function median(values) {
  if (!values.length) return null;
  const sorted = [...values].sort((a, b) => a - b);
  return (sorted[Math.floor((sorted.length - 1) / 2)] + sorted[Math.ceil((sorted.length - 1) / 2)]) / 2;
}

/** A grid of cells, each with its name and mean score; the better, the stronger the shade. */
function cellsPart(cells, whole) {
  const closed = cells.some(([, cell]) => cell.scores.closed_loop);
  const told = closed ? scoreOf("closed_loop") : whole.scores.success ? scoreOf("success") : headline(whole);
  const { key, title, unit } = told;
  return h(
    "div",
    {},
    h("div", { class: "heading sub" }, h("h3", {}, `${title[0].toUpperCase()}${title.slice(1)} by cell`, h("span", { class: "unit" }, ` ${unit}`))),
    h(
      "div",
      { class: "panel cells" },
      cells.map(([name, cell]) => {
        const score = cell.scores[key];
        return h(
          "div",
          { class: "cell", style: { "--share": (0.35 * goodness(score?.mean, told)).toFixed(2) } },
          h("div", { class: "cell-name" }, name),
          h("b", {}, number(score?.mean)),
          h("span", { class: "quiet" }, ` n=${score?.n ?? 0}`),
        );
      }),
    ),
  );
}

/** Hash of the uploaded policy, or of the file that defines the agent. */
function source(submission) {
  const hash = submission.policy_sha256 ?? submission.source_sha256;
  return hash ? h("code", { title: hash }, short(hash)) : missing("the source of a remote agent is not known to the service");
}

/** The version of an agent that drives in an evaluation, be it a single ego of a mixed run. */
const versionIn = (row, name) => (row.agent === name ? row : Object.values(row.egos).find((one) => one.agent === name)).version;

function history(evaluations, name) {
  if (!evaluations.length) return null;
  const columns = [
    {
      title: "benchmark",
      choice: true,
      cell: (row) => h("a", { href: `/evaluations/${encodeURIComponent(row.id)}` }, row.benchmark),
      csv: (row) => row.benchmark,
    },
    evaluations.some(isMixed) && {
      title: "agents of a mixed run",
      css: "named",
      cell: (row) => (isMixed(row) ? agentsOf(row).join(", ") : missing("one agent drove all egos")),
      csv: (row) => (isMixed(row) ? agentsOf(row).join(" ") : ""),
    },
    { title: "version", numeric: true, cell: (row) => versionIn(row, name) },
    { title: "status", choice: true, cell: (row) => standing(row.status), csv: (row) => row.status },
    {
      title: "episodes",
      css: "estimate",
      cell: (row) =>
        h(
          "div",
          { class: "counted" },
          bar(row.progress, "episodes done"),
          h("span", { class: "number quiet" }, `${row.progress.done} / ${row.progress.total}`),
        ),
      csv: (row) => row.progress,
    },
    { title: "created", cell: (row) => h("time", {}, moment(row.created)), csv: (row) => row.created },
  ].filter(Boolean);
  return h(
    "section",
    {},
    h("div", { class: "heading" }, h("h2", {}, "Evaluations"), copyButton(columns, evaluations)),
    h("div", { class: "panel wide" }, table(columns, evaluations, { name: "evaluations" })),
  );
}

function versions(submissions) {
  if (submissions.failure) return h("section", {}, unread("Versions", submissions.failure));
  if (!submissions.length) return null;
  const columns = [
    { title: "version", cell: (row) => `v${row.version}` },
    { title: "kind", cell: (row) => row.kind },
    { title: "track", cell: (row) => row.track },
    { title: "entry", cell: (row) => h("code", {}, row.entry), csv: (row) => row.entry },
    { title: "control", cell: (row) => row.control },
    { title: "source", cell: (row) => source(row), csv: (row) => row.policy_sha256 ?? row.source_sha256 },
    { title: "submitted", cell: (row) => h("time", {}, moment(row.created)), csv: (row) => row.created },
  ];
  return h("section", {}, h("h2", {}, "Versions"), h("div", { class: "panel wide" }, table(columns, submissions, { name: "versions" })));
}
