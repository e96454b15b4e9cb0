/** One evaluation: live progress by cell, its scores, and its episodes, the lowest score first. */

import { get, getAll, listen, page } from "../api.js";
import { byId, fill, h, mark, s } from "../dom.js";
import { agentName, missing } from "../estimate.js";
import { bar, isLost, measures, standing } from "../evaluation.js";
import { moment, number, softwareText, span } from "../format.js";
import { measureColumns, measuredBy, worstFirst } from "../measured.js";
import { agentsOf, agentsText, byAgent, driverOf, driversLine, isMixed } from "../mixed.js";
import { staleNotice, unread } from "../notice.js";
import { colours, subject } from "../subject.js";
import { copyButton, renewed, table } from "../table.js";
import { turns } from "../turns.js";
import { SIGNS, ending, infractionText, label, meaning, words } from "../words.js";

const REFRESH_MS = 1500;
const RETRY_MS = 10_000;
const MOST_TROUBLED = 20;
const FAULTS = /agent could not be set up|agent raised|agent's action|agent did not answer/;

const id = subject();
const base = `/v1/evaluations/${encodeURIComponent(id)}`;
const finished = (status) => ["done", "failed", "cancelled"].includes(status);
const state = { evaluation: null, episodes: [], metrics: null, failure: null, colour: {}, started: performance.now(), before: 0 };
const notice = staleNotice();
const reads = turns();
const attempts = turns();

page(async () => {
  await read();
  const { agent } = state.evaluation;
  const colour = (state.colour = await colours(agentsOf(state.evaluation)));
  state.started = performance.now();
  state.before = ended();
  fill(
    byId("content"),
    title(),
    notice.element,
    h("dl", { class: "tiles", id: "tiles" }),
    h(
      "section",
      { "aria-label": "Progress" },
      h("h2", {}, "Progress by cell"),
      h("div", { class: "panel progress", id: "progress" }),
    ),
    h("section", { id: "scores" }),
    h("section", { id: "episodes" }),
    h("section", { id: "attempts" }),
  );
  byId("content").style.setProperty("--agent", colour[agent] ?? "var(--accent)");
  show();
  if (!finished(state.evaluation.status)) live();
});

/** Reads the evaluation, all of its episodes and its metrics again; false if a later read has begun meanwhile. */
async function read() {
  const isLast = reads();
  let failure = null; // of the metrics, without which the rest is shown
  const [evaluation, episodes, metrics] = await Promise.all([
    get(base),
    getAll(`${base}/episodes`),
    get(`${base}/metrics`).catch((error) => {
      failure = error;
      return state.metrics;
    }),
  ]);
  if (!isLast()) return false;
  Object.assign(state, { evaluation, episodes, metrics, failure });
  return true;
}

/** Reads everything again and shows it. */
async function renew() {
  if (await read()) show();
}

/** Follows the progress: each event moves a bar at once; the tables change when no event has come for a while. */
function live() {
  let timer = 0;
  const refresh = (wait_ms = REFRESH_MS) => {
    clearTimeout(timer);
    timer = setTimeout(() => renew().then(notice.clear, later), wait_ms);
  };
  const later = (error) => {
    console.info(error);
    notice.tell(error);
    refresh(RETRY_MS);
  };
  const reread = async () => {
    await renew();
    return !finished(state.evaluation.status);
  };
  const hear = (event, name) => {
    if (name === "episode") {
      const episode = state.episodes.find((one) => one.id === event.episode);
      if (episode) episode.status = event.status;
    } else {
      Object.assign(state.evaluation, event);
    }
    if (name === "end") stop();
    showProgress();
    refresh();
  };
  const stop = listen(`${base}/progress`, ["state", "episode", "end"], { hear, reread, notice });
}

function show() {
  showProgress();
  showScores();
  showEpisodes();
  showAttempts().catch((error) => {
    console.info(error);
    fill(byId("attempts"), unread("Attempts and failures", error));
  });
}

function title() {
  const { evaluation: one, colour } = state;
  return h(
    "div",
    { class: "title" },
    h("p", { class: "crumbs quiet" }, h("a", { href: "/evaluations" }, "evaluations"), " / evaluation"),
    h("h1", {}, `${agentsText(one)} on ${one.benchmark}`),
    isMixed(one) && h("p", { class: "byline" }, h("span", {}, "mixed run:"), driversLine(one, colour)),
    h(
      "p",
      { class: "byline" },
      !isMixed(one) && [agentName(one.agent, colour[one.agent]), h("span", { class: "quiet" }, `version ${one.version}`)],
      !isParking() && !measuredBy(state.episodes[0]) && h("a", { href: `/evaluations/${encodeURIComponent(id)}/map` }, "map of infractions"),
      h("a", { href: `${base}/metrics` }, "JSON"),
      h("a", { href: `${base}/metrics.csv` }, "CSV"),
    ),
  );
}

/** Whether the episodes are parking lots, which have other facts than drives on roads. */
const isParking = () => state.episodes[0]?.cell === "lot";

const count = (status, some = state.episodes) => some.filter((one) => one.status === status).length;
const countLost = (some = state.episodes) => some.filter(isLost).length;
/** Episodes of a status; of a secret run it is told how many there are, and not which. */
const total = (status) => (state.evaluation.withheld ? state.evaluation.progress[status] : count(status));
const ended = () => total("done") + total("lost") + total("cancelled");

function showProgress() {
  const { evaluation, episodes } = state;
  const left = episodes.length - ended();
  const rate = (ended() - state.before) / Math.max(1, (performance.now() - state.started) / 1000);
  fill(
    byId("tiles"),
    [
      ["status", standing(evaluation.status)],
      ["episodes", `${total("done")} / ${episodes.length}`],
      ["lost", String(countLost())],
      ["time left", finished(evaluation.status) ? "—" : rate > 0 ? `about ${span(left / rate)}` : "unknown"],
      ["seeds", evaluation.seeds ? String(evaluation.seeds.length) : "withheld"],
      ["started", moment(evaluation.started ?? evaluation.created)],
      ["driven with", evaluation.dohyo_versions.length ? softwareText(evaluation) : "—"],
    ].map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))),
  );
  const cells = [...new Set(episodes.map((one) => one.cell))];
  fill(
    byId("progress"),
    evaluation.withheld ? progressRow("all cells", evaluation.progress, evaluation.progress.done) : cells.map(progressOf),
    evaluation.failure && h("p", { class: "problem" }, evaluation.failure),
    h(
      "p",
      { class: "note key" },
      h("span", {}, h("i", { class: "swatch done" }), "done"),
      h("span", {}, h("i", { class: "swatch running" }), "running"),
      h("span", {}, h("i", { class: "swatch lost" }), "lost"),
    ),
  );
}

function progressOf(cell) {
  const own = state.episodes.filter((one) => one.cell === cell);
  const done = count("done", own.filter((one) => !isLost(one)));
  const numbers = { done, running: count("running", own), lost: countLost(own), total: own.length };
  return progressRow(`cell ${cell}`, numbers, count("done", own), cell);
}

const progressRow = (label, numbers, done, title = label) =>
  h(
    "div",
    { class: "bar-row" },
    h("span", {}, title),
    bar(numbers, label),
    h("span", { class: "number numeric" }, `${done} / ${numbers.total}`),
  );

function showScores() {
  const summary = state.metrics?.all;
  const kind = measuredBy(state.episodes[0]);
  if (summary && isMixed(state.evaluation)) fill(byId("scores"), byAgent(state.metrics, state.colour));
  else if (summary) fill(byId("scores"), h("h2", {}, "Scores"), measures(summary, kind ? 8 : 4, kind?.keys[0]));
  if (state.failure && summary) byId("scores").append(...unread(null, state.failure).filter(Boolean));
  else if (state.failure) fill(byId("scores"), unread("Scores", state.failure));
}

function showEpisodes() {
  const rows = state.episodes
    .map((one) => ({ ...one, ego: worst(one), marks: (one.summary?.egos ?? []).flatMap((ego) => ego.marks ?? []) }))
    .sort((a, b) => (headline(scored(a)) ?? 999) - (headline(scored(b)) ?? 999) || a.position - b.position);
  const kind = measuredBy(state.episodes[0]);
  const columns = kind ? measuredColumns(kind) : isParking() ? lotColumns() : driveColumns(rows.some((row) => row.ego?.closed_loop));
  const heading = kind?.heading ?? "Episodes, lowest score first";
  if (renewed(byId("episodes"), columns, rows)) {
    byId("episodes").querySelector(".marks-key").replaceChildren(key(rows));
    return;
  }
  fill(
    byId("episodes"),
    h("div", { class: "heading" }, h("h2", {}, heading), copyButton(columns, rows)),
    h("div", { class: "panel wide" }, table(columns, rows, { name: "episodes", caption: heading, css: "drives" })),
    h("div", { class: "marks-key" }, key(rows)),
  );
}

/** Columns of drives on roads; `closed`: with the closed-loop score. */
function driveColumns(closed) {
  return [
    {
      title: "scenario",
      cell: (row) => h("a", { href: `/episodes/${encodeURIComponent(row.id)}` }, named(row)),
      csv: (row) => row.scenario,
    },
    { title: "seed", numeric: true, cell: (row) => row.seed },
    isMixed(state.evaluation) && {
      title: "agent of the lowest",
      choice: true,
      cell: (row) => (row.ego ? lowest(row.ego) : "—"),
      csv: (row) => row.ego && driverOf(state.evaluation, row.ego.name).agent,
    },
    { title: "ending", choice: true, sort: (row) => (row.ego ? ending(row.ego.status) : row.status), cell: (row) => how(row), csv: (row) => row.ego?.status ?? row.status },
    closed && {
      title: "closed loop",
      unit: "%",
      numeric: true,
      cell: (row) => score(row, "closed_loop", row.ego?.closed_loop),
      csv: (row) => scored(row)?.closed_loop?.closed_loop,
    },
    { title: "DS", unit: "%", numeric: true, cell: (row) => score(row, "ds"), csv: (row) => scored(row)?.ds },
    { title: "RC", unit: "%", numeric: true, cell: (row) => score(row, "rc"), csv: (row) => scored(row)?.rc },
    { title: "IP", numeric: true, cell: (row) => score(row, "ip"), csv: (row) => scored(row)?.ip },
    { title: "along the route", css: "along", cell: route, sort: (row) => row.marks.length, csv: (row) => ({ infractions: row.marks.length }) },
    {
      title: "time",
      unit: "s",
      numeric: true,
      cell: (row) => (row.ego ? number(row.ego.duration_s) : "—"),
      csv: (row) => row.ego?.duration_s,
    },
  ].filter(Boolean);
}

/** The agent of the ego with the lowest score, and that ego. */
function lowest(ego) {
  const { agent } = driverOf(state.evaluation, ego.name);
  return [agentName(agent, state.colour[agent]), h("div", { class: "quiet small" }, ego.name)];
}

/** Columns of days and mornings. */
function measuredColumns(kind) {
  return [
    {
      title: "episode",
      cell: (row) => h("a", { href: `/episodes/${encodeURIComponent(row.id)}` }, named(row)),
      csv: (row) => row.scenario,
    },
    { title: "seed", numeric: true, cell: (row) => row.seed },
    { title: "ending", choice: true, sort: (row) => (row.ego ? ending(row.ego.status) : row.status), cell: (row) => how(row), csv: (row) => row.ego?.status ?? row.status },
    ...measureColumns(kind),
  ];
}

/** Columns of parking lots. */
function lotColumns() {
  const ofKarts = (name) => ({
    numeric: true,
    sort: (row) => row.ego?.parking[name] ?? -1,
    cell: (row) => (row.ego ? `${row.ego.parking[name]} / ${row.ego.parking.karts}` : "—"),
    csv: (row) => ({ [name]: row.ego?.parking[name] }),
  });
  return [
    {
      title: "lot",
      cell: (row) => h("a", { href: `/episodes/${encodeURIComponent(row.id)}` }, row.seed === null ? named(row) : `lot ${row.seed}`),
      csv: (row) => row.seed,
    },
    { title: "ending", choice: true, sort: (row) => (row.ego ? ending(row.ego.status) : row.status), cell: (row) => how(row), csv: (row) => row.ego?.status ?? row.status },
    { title: "parked", unit: "karts", ...ofKarts("parked") },
    { title: "aligned", unit: "karts", ...ofKarts("aligned") },
    { title: "contacts", unit: "karts", ...ofKarts("contacts") },
    {
      title: "time",
      unit: "s",
      numeric: true,
      cell: (row) => (row.ego ? number(row.ego.duration_s) : "—"),
      csv: (row) => row.ego?.duration_s,
    },
    {
      title: "driven",
      unit: "m",
      numeric: true,
      cell: (row) => (row.ego ? number(row.ego.driven_m) : "—"),
      csv: (row) => row.ego?.driven_m,
    },
  ];
}

/** The attempts without a good end, of the first episodes that have some. */
async function showAttempts() {
  const isLast = attempts();
  const troubled = state.episodes.filter(hasTrouble);
  const read = troubled.slice(0, MOST_TROUBLED);
  const lists = await Promise.all(read.map((one) => getAll(`/v1/episodes/${encodeURIComponent(one.id)}/attempts`)));
  const rows = lists.flatMap((list, i) => list.map((one) => ({ ...one, episode: read[i] }))).filter((one) => one.outcome !== "done");
  if (!isLast()) return;
  if (!rows.length) return fill(byId("attempts"));
  const columns = [
    {
      title: "episode",
      cell: ({ episode }) => h("a", { href: `/episodes/${encodeURIComponent(episode.id)}` }, named(episode)),
      csv: ({ episode }) => named(episode),
    },
    { title: "attempt", numeric: true, cell: (row) => row.number },
    { title: "ending", choice: true, cell: (row) => (row.outcome ?? "running").replaceAll("_", " ") },
    { title: "reason", cell: (row) => h("span", { class: "reason" }, reason(row) ?? "—"), csv: reason },
    { title: "charged", choice: true, cell: (row) => (row.charged ? "yes" : "no") },
    { title: "processor", unit: "s", numeric: true, cell: (row) => (row.processor_s === null ? "—" : number(row.processor_s)), csv: (row) => row.processor_s },
    { title: "started", cell: (row) => moment(row.started), sort: (row) => row.started, csv: (row) => row.started },
  ];
  const said = troubled.length > read.length ? `of the first ${read.length} of ${troubled.length} episodes with failed attempts` : "";
  if (renewed(byId("attempts"), columns, rows)) {
    byId("attempts").querySelector(".part").replaceWith(part(said));
    return;
  }
  fill(
    byId("attempts"),
    h("div", { class: "heading" }, h("h2", {}, "Attempts and failures"), copyButton(columns, rows)),
    h("div", { class: "panel wide" }, table(columns, rows, { name: "attempts", caption: "Attempts and failures" })),
    part(said),
  );
}

const part = (text) => h("p", { class: "note part", hidden: !text }, text);

/** Whether an episode has an attempt that gave no record, or a fault of its agent. */
const hasTrouble = (one) =>
  one.attempts > 1 || ["lost", "cancelled"].includes(one.status) || (one.summary?.egos ?? []).some((ego) => FAULTS.test(ego.status));

/** Why an attempt ended; of a fault of the agent, which is in the record, the drive's ending. */
const reason = ({ why, episode }) => why ?? (episode.summary?.egos ?? []).map((ego) => ego.status).find((status) => FAULTS.test(status));

const named = (episode) => episode.scenario ?? `episode ${episode.position + 1}`;

/** The drive of an episode that counts. */
const scored = (row) => (isLost(row) ? null : row.ego);

/** A score of a drive; an unfinished or lost episode has none. */
const score = (row, name, scores = row.ego) =>
  scores && row.status === "done" && !isLost(row) ? number(scores[name]) : missing("the episode has not ended, or was lost");

/** The score by which episodes are sorted. */
const headline = (ego) => {
  if (ego?.forecast || ego?.morning) return worstFirst(ego, measuredBy(state.episodes[0]));
  if (ego?.parking) return (100 * ego.parking.parked) / ego.parking.karts;
  return ego?.closed_loop?.closed_loop ?? ego?.ds;
};

/** The ego with the lowest score of an episode; most episodes have only one ego. */
function worst(episode) {
  const egos = episode.summary?.egos ?? [];
  return egos.length ? egos.reduce((a, b) => (headline(b) < headline(a) ? b : a)) : null;
}

function how(row) {
  if (!row.ego) return [standing(row.status), row.failure && h("div", { class: "reason" }, row.failure)];
  const kind = meaning(row.ego.status);
  return h("span", { class: `status ${kind}` }, h("i", { "aria-hidden": "true" }, SIGNS[kind]), ending(row.ego.status));
}

/** The route as a line with the driven part thick. The mark of each infraction opens the replay at that moment. */
function route(row) {
  if (!row.ego) return "";
  const length = row.ego.route_m || 1;
  const driven = Math.min(1, row.ego.rc / 100);
  const at = (metres) => `${(100 * Math.min(1, metres / length)).toFixed(1)}%`;
  return s(
    "svg",
    { class: "route", role: "group", "aria-label": `${number(row.ego.rc)} % driven, ${row.marks.length} infractions` },
    s("line", { class: "axis", x1: 0, x2: "100%", y1: 12, y2: 12 }),
    s("line", { class: "driven", x1: 0, x2: `${100 * driven}%`, y1: 12, y2: 12 }),
    s("line", { class: "end", x1: "100%", x2: "100%", y1: 6, y2: 18 }),
    row.marks.map((one) =>
      s(
        "svg",
        { x: at(one.route_m), y: 12, overflow: "visible" },
        s(
          "a",
          { href: `/episodes/${encodeURIComponent(row.id)}#t=${one.time_s.toFixed(1)}`, class: one.at_fault === false ? "innocent" : null },
          s("title", {}, infractionText(one)),
          s("path", { d: words.marks[one.kind].path }),
        ),
      ),
    ),
  );
}

function key(rows) {
  const kinds = Object.keys(words.marks).filter((kind) =>
    rows.some((row) => row.marks.some((one) => one.kind === kind)),
  );
  if (!kinds.length) return "";
  return h(
      "p",
      { class: "note key" },
      kinds.map((kind) => h("span", {}, mark(kind, words.marks[kind].path), label(kind))),
      h("span", {}, "a hollow mark: not at fault; a mark opens the replay at the time of its infraction"),
  );
}
