/** The organiser's page of a challenge: texts, phases, baselines, invitations, teams and entries. */

import { get, getAll, page, send } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { standing } from "../evaluation.js";
import { confirmed, field, form, input, select, shownOnce } from "../forms.js";
import { moment } from "../format.js";
import { countdown, listed, nextMoment, stateOf } from "../phases.js";
import { subject } from "../subject.js";
import { copyButton, table } from "../table.js";

const name = subject();
const base = `/v1/challenges/${encodeURIComponent(name)}`;
const AUDIENCES = [["public", "everybody"], ["participants", "participants"], ["organisers", "organisers"]];

page(async () => {
  const [challenge, benchmarks] = await Promise.all([get(base), get("/v1/benchmarks")]);
  fill(
    byId("content"),
    h(
      "div",
      { class: "title" },
      h("p", { class: "crumbs quiet" }, h("a", { href: `/challenges/${encodeURIComponent(name)}` }, challenge.title), " / organise"),
      h("h1", {}, `Organise ${challenge.title}`),
    ),
    h("section", { id: "phases" }),
    h("section", { id: "baselines" }),
    h("section", { id: "invitations" }),
    h("section", { id: "entries" }),
    textPart(challenge),
  );
  showPhases(challenge, benchmarks);
  await Promise.all([showBaselines(challenge), showInvitations(), showEntries(challenge)]);
});

function showPhases(challenge, benchmarks) {
  const columns = [
    { title: "phase", cell: (row) => h("a", { href: `/challenges/${encodeURIComponent(name)}?phase=${encodeURIComponent(row.name)}` }, row.name), csv: (row) => row.name },
    { title: "state", choice: true, cell: stateOf, csv: (row) => row.state },
    { title: "benchmark", cell: (row) => row.benchmark },
    { title: "seeds", cell: (row) => [h("code", {}, listed(row.seeds ?? [])), row.secret && h("span", { class: "quiet small" }, " secret")], csv: (row) => (row.seeds ?? []).join(" ") },
    { title: "runs", unit: "per period", numeric: true, cell: (row) => row.runs_per_period, csv: (row) => row.runs_per_period },
    {
      title: "next",
      cell: (row) => {
        const next = nextMoment(row);
        return next ? [`${next[0]} in `, countdown(next[1])] : "—";
      },
      csv: (row) => nextMoment(row)?.[1] ?? "",
    },
    { title: "closes", cell: (row) => h("time", {}, moment(row.closes)), csv: (row) => row.closes },
  ];
  fill(
    byId("phases"),
    h("h2", {}, "Phases"),
    challenge.phases.length > 0 && h("div", { class: "panel wide" }, table(columns, challenge.phases, { name: "phases", caption: "Phases" })),
    postponePart(challenge),
    h("details", { class: "panel", open: challenge.phases.length === 0 }, h("summary", {}, "add a phase"), phaseForm(benchmarks)),
  );
}

/** Local date and time of an input, as the service reads it; null for an empty one. */
const instant = (text) => (text ? new Date(text).toISOString() : null);

function phaseForm(benchmarks) {
  const two = (title, key, chosen) => field(title, key, select(AUDIENCES, chosen));
  return form(
    [
      field("Name", "name", input("text", { required: true, maxlength: 100 })),
      field("Benchmark", "benchmark", select(benchmarks.map((one) => [one.name, one.name]))),
      field("Seeds", "draw_seeds", input("number", { min: 1, max: 100, placeholder: "the benchmark's own" }), "A number: so many are drawn at random, held out from training. Empty: the benchmark's own seeds."),
      field("Secret", "secret", select([["", "no"], ["yes", "until the phase ends"]]), "Withholds seeds, scenarios, replays and records. Needs drawn seeds."),
      field("Ranked runs of a team", "runs_per_period", input("number", { min: 1, max: 1000, value: 3, required: true })),
      field("within hours", "period_s", input("number", { min: 0.02, step: "any", value: 24, required: true })),
      field("A team's place", "counts", select([["best", "its best complete run"], ["first", "the run that it orders first"]])),
      field("Opens", "opens", input("datetime-local", { step: 1 }), "Empty: at once."),
      field("Closes", "closes", input("datetime-local", { step: 1, required: true })),
      field("Grace, minutes", "grace_s", input("number", { min: 0, step: "any", value: 60 }), "Time after the closing in which runs may still end and count."),
      field("Track", "track", select([["", "any"], ["sensors", "sensors"], ["map", "map"], ["privileged", "privileged"]])),
      field("Agents", "verified_only", select([["", "all kinds"], ["yes", "built-in and ONNX only"]])),
      two("Board shown to", "board", "public"),
      two("Replays shown to", "replays", "participants"),
      two("Records shown to", "records", "participants"),
    ],
    "add the phase",
    async (values) => {
      const given = Object.fromEntries([...values].filter(([, value]) => value !== ""));
      const order = {
        ...given,
        runs_per_period: Number(given.runs_per_period),
        period_s: 3600 * Number(given.period_s),
        grace_s: 60 * Number(given.grace_s ?? 0),
        secret: given.secret === "yes",
        verified_only: given.verified_only === "yes",
        closes: instant(given.closes),
      };
      if (given.draw_seeds) order.draw_seeds = Number(given.draw_seeds);
      if (given.opens) order.opens = instant(given.opens);
      await send("POST", `${base}/phases`, order);
      location.reload();
    },
  );
}

/** Moves the closing of a phase to a later time; its grace follows. */
function postponePart(challenge) {
  const running = challenge.phases.filter((phase) => ["planned", "open"].includes(phase.state));
  if (running.length === 0) return null;
  const postponing = form(
    [
      field("Phase", "phase", select(running.map((phase) => [phase.id, phase.name]))),
      field("New end", "closes", input("datetime-local", { step: 1, required: true }), "A later time. No phase is brought forward, and none is opened again."),
    ],
    "postpone",
    async (values) => {
      await send("PATCH", `${base}/phases/${encodeURIComponent(values.get("phase"))}`, { closes: instant(values.get("closes")) });
      location.reload();
    },
  );
  return h("details", { class: "panel" }, h("summary", {}, "postpone the end of a phase"), postponing);
}

async function showBaselines(challenge) {
  const agents = (await getAll("/v1/agents")).filter((one) => one.owner === challenge.organiser && one.version);
  const columns = [
    { title: "submission", cell: (row) => h("a", { href: `/agents/${encodeURIComponent(row.agent)}` }, `${row.agent} v${row.version}`), csv: (row) => `${row.agent} v${row.version}` },
    { title: "kind", choice: true, cell: (row) => row.kind, csv: (row) => row.kind },
    {
      title: "remove",
      csv: null,
      cell: (row) => confirmed("remove", "really remove", "DELETE", `${base}/baselines/${encodeURIComponent(row.submission)}`, again),
    },
  ];
  const again = async () => showBaselines(await get(base));
  const marking = form(
    [
      field("Agent", "agent", select(agents.map((one) => [one.name, one.name]))),
      field("Version", "version", input("number", { min: 1, placeholder: "the latest" })),
    ],
    "mark as baseline",
    async (values) => {
      const order = { agent: values.get("agent") };
      if (values.get("version")) order.version = Number(values.get("version"));
      await send("POST", `${base}/baselines`, order);
      await again();
    },
  );
  marking.classList.add("in-line");
  fill(
    byId("baselines"),
    h("h2", {}, "Baselines"),
    h("p", { class: "note" }, "Submissions of the organiser: their ranked runs stand on the boards without a rank."),
    agents.length ? h("div", { class: "panel" }, marking) : h("p", { class: "note" }, h("a", { href: "/submit" }, "Submit an agent"), " first."),
    challenge.baselines.length > 0 && h("div", { class: "panel wide" }, table(columns, challenge.baselines, { name: "baselines", caption: "Baselines" })),
  );
}

async function showInvitations(fresh = null) {
  const rows = await getAll(`${base}/invitations`);
  const state = (row) => (row.redeemed ? "used" : row.revoked ? "revoked" : new Date(row.expires) < new Date() ? "expired" : "open");
  const columns = [
    { title: "for", cell: (row) => row.note || row.id, csv: (row) => row.note || row.id },
    { title: "team", cell: (row) => row.team ?? h("span", { class: "quiet" }, "a new one"), csv: (row) => row.team ?? "" },
    { title: "state", choice: true, cell: (row) => [state(row), row.redeemed_by && ` by ${row.redeemed_by}`], csv: state },
    { title: "expires", cell: (row) => h("time", {}, moment(row.expires)), csv: (row) => row.expires },
    {
      title: "revoke",
      csv: null,
      cell: (row) => (state(row) === "open" ? confirmed("revoke", "really revoke", "DELETE", `${base}/invitations/${encodeURIComponent(row.id)}`, () => showInvitations()) : ""),
    },
  ];
  const making = form(
    [
      field("For", "note", input("text", { maxlength: 200 }), "For yourself, such as the person."),
      field("Team", "team", input("text", { maxlength: 100 }), "Empty: the participant names a new team."),
      field("Valid for days", "expires_in_days", input("number", { min: 0.01, max: 365, step: "any", value: 14 })),
    ],
    "make an invitation",
    async (values) => {
      const order = { note: values.get("note"), expires_in_days: Number(values.get("expires_in_days") || 14) };
      if (values.get("team")) order.team = values.get("team");
      await showInvitations(await send("POST", `${base}/invitations`, order));
    },
  );
  making.classList.add("in-line");
  fill(
    byId("invitations"),
    h("h2", {}, "Invitations"),
    h("div", { class: "panel" }, making),
    fresh && shownOnce(`Invitation ${fresh.note ? `for ${fresh.note}` : ""}`, fresh.code, `Give it to one participant, who enters it at ${location.origin}/join. It cannot be shown again.`),
    rows.length > 0 && h("div", { class: "panel wide" }, table(columns, rows, { name: "invitations", caption: "Invitations" })),
  );
}

async function showEntries(challenge) {
  const [teams, ...lists] = await Promise.all([
    get(`${base}/teams`),
    ...challenge.phases.map((phase) => getAll(`/v1/evaluations?ranking=${encodeURIComponent(phase.id)}`)),
  ]);
  const teamOf = (owner) => teams.find((team) => team.members.includes(owner))?.name ?? "baseline";
  const phaseOf = (run) => challenge.phases.find((one) => one.id === run.ranking)?.name ?? "";
  const runs = lists.flat().sort((a, b) => (a.created < b.created ? 1 : -1));
  const columns = [
    { title: "team", choice: true, cell: (run) => teamOf(run.owner), csv: (run) => teamOf(run.owner) },
    { title: "run", cell: (run) => h("a", { href: `/evaluations/${encodeURIComponent(run.id)}` }, `${run.agent} v${run.version}`), csv: (run) => `${run.agent} v${run.version}` },
    { title: "kind", choice: true, cell: (run) => run.kind, csv: (run) => run.kind },
    { title: "phase", choice: true, cell: phaseOf, csv: phaseOf },
    { title: "status", choice: true, cell: (run) => standing(run.status), csv: (run) => run.status },
    { title: "episodes", numeric: true, cell: (run) => `${run.progress.done} / ${run.progress.total}`, csv: (run) => run.progress.done },
    { title: "what failed", cell: (run) => run.failure ?? "—", csv: (run) => run.failure ?? "" },
    { title: "ordered", cell: (run) => h("time", {}, moment(run.created)), csv: (run) => run.created },
  ];
  const members = [
    { title: "team", cell: (team) => team.name, csv: (team) => team.name },
    { title: "members", cell: (team) => team.members.join(", "), csv: (team) => team.members.join(" ") },
    { title: "since", cell: (team) => h("time", {}, moment(team.created)), csv: (team) => team.created },
  ];
  fill(
    byId("entries"),
    h("div", { class: "heading" }, h("h2", {}, "Entries"), runs.length > 0 && copyButton(columns, runs)),
    runs.length ? h("div", { class: "panel wide" }, table(columns, runs, { name: "entries", caption: "Entries" })) : h("p", { class: "note" }, "No ranked run yet."),
    h("h3", { class: "sub" }, "Teams"),
    teams.length ? h("div", { class: "panel wide" }, table(members, teams, { name: "teams", caption: "Teams" })) : h("p", { class: "note" }, "No team yet."),
  );
}

function textPart(challenge) {
  const rules = h("textarea", { rows: 10, maxlength: 100_000 });
  rules.value = challenge.rules;
  return h(
    "section",
    {},
    h("h2", {}, "Title and rules"),
    h(
      "div",
      { class: "panel" },
      form(
        [
          field("Title", "title", input("text", { required: true, maxlength: 200, value: challenge.title })),
          field("Rules", "rules", rules, "Headings with #, lists with -, **bold**, `code` and [links](https://…)."),
        ],
        "save",
        async (values) => {
          await send("PATCH", base, Object.fromEntries(values));
          location.assign(`/challenges/${encodeURIComponent(name)}`);
        },
      ),
    ),
  );
}
