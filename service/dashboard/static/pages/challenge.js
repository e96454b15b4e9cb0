/** One challenge: what is announced, its phases with their boards, the reader's own team and runs, and the rules. */

import { get, getAll, page, send } from "../api.js";
import { columnsOf, partText, readBoard, versionText } from "../board.js";
import { byId, fill, h } from "../dom.js";
import { missing } from "../estimate.js";
import { bar, standing } from "../evaluation.js";
import { confirmed, field, form, select } from "../forms.js";
import { moment, number } from "../format.js";
import { staleNotice } from "../notice.js";
import { conditions, countdown, nextMoment, period, runsLeft, stateOf } from "../phases.js";
import { prose } from "../prose.js";
import { colours, subject } from "../subject.js";
import { copyButton, renewed, table } from "../table.js";
import { turns } from "../turns.js";

const REFRESH_MS = 4000;
const RETRY_MS = 10_000;
const name = subject();
const base = `/v1/challenges/${encodeURIComponent(name)}`;
const finished = (run) => ["done", "failed", "cancelled"].includes(run.status);

page(async () => {
  const challenge = await get(base);
  document.title = `${challenge.title} · dohyo`;
  const phase = chosen(challenge.phases);
  fill(
    byId("content"),
    title(challenge),
    challenge.announcements.map(announcement),
    h("section", { id: "team" }),
    phase ? phasePart(challenge, phase) : h("section", { class: "state" }, h("h2", {}, "No phase yet"), h("p", {}, "The organiser has not added a phase.")),
    challenge.rules && h("section", {}, h("h2", {}, "Rules"), prose(challenge.rules)),
  );
  if (challenge.my_team) await teamPart(challenge);
  if (phase) await boardPart(phase);
});

/** The phase that the address names, else the open one, else the latest that has begun. */
function chosen(phases) {
  const wanted = new URLSearchParams(location.search).get("phase");
  const begun = phases.filter((one) => one.state !== "planned");
  return phases.find((one) => one.name === wanted) ?? phases.find((one) => one.state === "open") ?? begun.at(-1) ?? phases[0];
}

function title(challenge) {
  return h(
    "div",
    { class: "title" },
    h("p", { class: "crumbs quiet" }, h("a", { href: "/challenges" }, "challenges"), " / challenge"),
    h("h1", {}, challenge.title),
    h(
      "p",
      { class: "byline" },
      h("span", { class: "quiet" }, `by ${challenge.organiser}`),
      h("span", { class: "quiet" }, `${challenge.teams} ${challenge.teams === 1 ? "team" : "teams"}`),
      challenge.my_team
        ? h("span", {}, "your team: ", h("b", {}, challenge.my_team))
        : h("a", { href: "/join" }, "take part with an invitation"),
      challenge.may_organise && h("a", { href: `/challenges/${encodeURIComponent(name)}/organise` }, "organise"),
      h("a", { href: base }, "JSON"),
    ),
  );
}

function announcement(one) {
  const winners = one.winners?.map((row) => `${row.team ?? row.agent} (${row.agent} v${row.version}, ${number(row.score)})`);
  return h(
    "p",
    { class: "announcement" },
    h("b", {}, `The board of phase ${one.phase} is final. `),
    winners?.length ? `First: ${winners.join(", ")}. ` : winners ? "No run was complete. " : "It is not shown to you. ",
    h("span", { class: "quiet" }, `${one.places} ${one.places === 1 ? "place" : "places"}, ${moment(one.finalised)}`),
  );
}

function phasePart(challenge, phase) {
  const next = nextMoment(phase);
  return h(
    "section",
    {},
    h(
      "div",
      { class: "heading" },
      h("h2", {}, `Phase ${phase.name} `, stateOf(phase)),
      next && h("p", {}, `${next[0]} in `, countdown(next[1], () => reloadAfter(phase))),
    ),
    challenge.phases.length > 1 &&
      h(
        "p",
        { class: "links tabs" },
        challenge.phases.map((one) =>
          h("a", { href: `?phase=${encodeURIComponent(one.name)}`, "aria-current": one === phase ? "true" : null }, one.name),
        ),
      ),
    h("dl", { class: "tiles five" }, conditions(phase).map(([key, value]) => h("div", {}, h("dt", {}, key), h("dd", {}, value)))),
    h("div", { id: "board" }, h("p", { class: "loading", role: "status" }, "Reading the board …")),
  );
}

/** Loads the page again once the service too has moved the phase on; a reload before that would only lose what was typed. */
async function reloadAfter(phase) {
  const now = await get(base).catch((error) => console.info(error));
  const same = now?.phases.find((one) => one.id === phase.id);
  if (now && same?.state !== phase.state) location.reload();
  else setTimeout(() => reloadAfter(phase), RETRY_MS);
}

async function boardPart(phase) {
  if (!phase.board_visible) {
    fill(byId("board"), h("p", { class: "note" }, `The board of this phase is shown to its ${phase.board} alone.`));
    return;
  }
  const board = await readBoard(new URLSearchParams({ ranking: phase.id }));
  const colour = await colours(board.rows.map((row) => row.agent));
  const columns = columnsOf(board.rows, board.metric, colour, 3);
  const csv = `/v1/leaderboard.csv?ranking=${encodeURIComponent(phase.id)}`;
  fill(
    byId("board"),
    h("div", { class: "heading sub" }, h("h3", {}, board.final ? "Final board" : "Board"), board.rows.length > 0 && copyButton(columns, board.rows)),
    board.rows.length
      ? h("div", { class: "panel wide" }, table(columns, board.rows, { name: "board", css: "board", caption: `Board of phase ${phase.name}` }))
      : h("p", { class: "note" }, board.final ? "No complete run was on time." : "No complete run yet."),
    h(
      "p",
      { class: "note" },
      partText(board),
      versionText(board.rows),
      `Ranked by ${board.description}. Rows without a significant difference on the same drives share a rank. P(A better) is the probability that a row (A) is better than the row above (B). `,
      "Run by the service: built-in and ONNX agents; of a remote agent, computing time, memory and program cannot be checked. Runs: ranked runs ordered, and after the minus sign attempts at episodes that gave no record. ",
      h("a", { href: csv }, "CSV"),
    ),
  );
}

/** The reader's team: runs left, a form that starts a run, and all runs with their failures. */
async function teamPart(challenge) {
  const [me, teams, agents] = await Promise.all([get("/v1/me"), get(`${base}/teams`), getAll("/v1/agents")]);
  const members = teams.find((one) => one.name === challenge.my_team)?.members ?? [me.owner];
  const mine = agents.filter((one) => one.owner === me.owner && one.version);
  const runs = h("div", { id: "runs" });
  const quota = h("div", {});
  const notice = staleNotice();
  const cancels = new Map();
  const began = turns();
  let timer = 0;
  let shown = "";
  const later = (wait_ms) => {
    clearTimeout(timer);
    timer = setTimeout(again, wait_ms);
  };
  const show = async () => {
    const isLast = began();
    const all = await readRuns(challenge, members, mine);
    if (!isLast()) return;
    notice.clear();
    fill(quota, quotas(challenge, all, members)); // it changes with time alone, too
    if (shown !== JSON.stringify(all)) showRuns(runs, challenge, all, (run) => cancelOf(cancels, run, me, again));
    shown = JSON.stringify(all);
    if (all.some((run) => !finished(run))) later(REFRESH_MS);
  };
  const again = () =>
    show().catch((error) => {
      notice.tell(error);
      later(RETRY_MS);
    });
  fill(
    byId("team"),
    h("div", { class: "heading" }, h("h2", {}, `Your team: ${challenge.my_team}`), h("p", { class: "links" }, h("a", { href: `/submit?challenge=${encodeURIComponent(name)}` }, "submit an agent"), " · ", h("a", { href: "/account" }, "your tokens"))),
    h("p", { class: "note" }, `Members: ${members.join(", ")}`),
    quota,
    mine.length
      ? starting(challenge, mine, again)
      : h("section", { class: "state" }, h("h3", {}, "No agent yet"), h("p", {}, h("a", { class: "button", href: `/submit?challenge=${encodeURIComponent(name)}` }, "submit an agent"))),
    notice.element,
    runs,
  );
  await show();
}

/** Ranked runs of the team in all phases, and practice runs of the reader's agents on the benchmarks of the phases. */
async function readRuns(challenge, members, mine) {
  const benchmarks = new Set(challenge.phases.map((one) => one.benchmark));
  const ranked = challenge.phases.map((one) => getAll(`/v1/evaluations?ranking=${encodeURIComponent(one.id)}`));
  const practice = mine.map((one) => getAll(`/v1/evaluations?agent=${encodeURIComponent(one.name)}`));
  const lists = await Promise.all([...ranked, ...practice]);
  const own = lists.flat().filter((run) => (run.ranking ? members.includes(run.owner) : benchmarks.has(run.benchmark)));
  const phases = new Set(challenge.phases.map((one) => one.id));
  const kept = own.filter((run) => !run.ranking || phases.has(run.ranking));
  return [...new Map(kept.map((run) => [run.id, run])).values()].sort((a, b) => (a.created < b.created ? 1 : -1));
}

function quotas(challenge, runs, members) {
  const open = challenge.phases.filter((one) => one.state === "open");
  if (!open.length) return h("p", { class: "note" }, "No phase is open; practice runs can be started.");
  return h(
    "dl",
    { class: "tiles" },
    open.map((phase) =>
      h(
        "div",
        {},
        h("dt", {}, `ranked runs left in ${phase.name}`),
        h("dd", {}, `${runsLeft(phase, runs, members)} of ${phase.runs_per_period} per ${period(phase.period_s)}`),
      ),
    ),
  );
}

function starting(challenge, agents, after) {
  const open = challenge.phases.filter((one) => one.state === "open");
  const benchmarks = [...new Set(challenge.phases.map((one) => one.benchmark))];
  const kinds = [
    ...open.map((one) => [`ranked ${one.id}`, `ranked, phase ${one.name}`]),
    ...benchmarks.map((one) => [`practice ${one}`, `practice on ${one}`]),
  ];
  const starts = form(
    [
      field("Agent", "agent", select(agents.map((one) => [one.name, `${one.name} v${one.version} (${one.kind})`]))),
      field("Run", "ranking", select(kinds), "A ranked run counts and uses up the quota, also where it is cancelled. A practice run enters no board."),
    ],
    "start the run",
    async (values) => {
      const [kind, target] = values.get("ranking").split(/ (.*)/s);
      const phase = challenge.phases.find((one) => one.id === target);
      const order = { agent: values.get("agent"), benchmark: phase?.benchmark ?? target };
      if (kind === "ranked") Object.assign(order, { ranked: true, ranking: target });
      await send("POST", "/v1/evaluations", order);
      await after();
    },
  );
  starts.classList.add("in-line");
  return h("div", { class: "panel" }, starts);
}

/** What cancels a run. It is made once, so that a press on it that waits for the second one outlives new rows. */
function cancelOf(cancels, run, me, after) {
  if (run.owner !== me.owner || finished(run)) return "";
  if (!cancels.has(run.id) || cancels.get(run.id).querySelector("[role=alert]")) {
    const button = confirmed("cancel", "really cancel", "POST", `/v1/evaluations/${encodeURIComponent(run.id)}/cancel`, after);
    cancels.set(run.id, h("div", {}, button));
  }
  return cancels.get(run.id);
}

function showRuns(place, challenge, runs, cancel) {
  if (!runs.length) return fill(place, h("p", { class: "note" }, "No run yet."));
  const phaseOf = (run) => challenge.phases.find((one) => one.id === run.ranking)?.name;
  const columns = [
    { title: "run", css: "named", cell: (run) => h("a", { href: `/evaluations/${encodeURIComponent(run.id)}` }, `${run.agent} v${run.version}`), csv: (run) => `${run.agent} v${run.version}` },
    { title: "kind", choice: true, cell: (run) => (run.ranking ? `ranked, ${phaseOf(run)}` : "practice"), csv: (run) => (run.ranking ? `ranked, ${phaseOf(run)}` : "practice") },
    { title: "status", choice: true, cell: (run) => standing(run.status), csv: (run) => run.status },
    {
      title: "episodes",
      css: "estimate",
      sort: (run) => run.progress.done,
      cell: (run) => h("div", { class: "counted" }, bar(run.progress, "episodes done"), h("span", { class: "number quiet" }, `${run.progress.done} / ${run.progress.total}`)),
      csv: (run) => run.progress,
    },
    { title: "what failed", cell: failure, csv: (run) => run.failure ?? "" },
    { title: "ordered", cell: (run) => h("time", {}, moment(run.created)), csv: (run) => run.created },
    { title: "cancel", csv: null, cell: cancel },
  ];
  if (renewed(place, columns, runs)) return;
  fill(
    place,
    h("div", { class: "heading sub" }, h("h3", {}, "Your team's runs"), copyButton(columns, runs)),
    h("div", { class: "panel wide" }, table(columns, runs, { name: "runs", caption: "Your team's runs" })),
  );
}

/** The failure of a run, and a link to the failures and logs of its episodes. */
function failure(run) {
  if (run.withheld && finished(run)) return missing("shown when the phase has ended");
  const faults = run.progress.lost + (run.failure ? 1 : 0);
  if (!faults) return h("span", { class: "quiet" }, "—");
  return [run.failure && h("div", { class: "reason" }, run.failure), h("a", { href: `/evaluations/${encodeURIComponent(run.id)}#episodes` }, run.progress.lost ? `${run.progress.lost} lost episodes` : "episodes")];
}
