/** Evaluations side by side: paired differences, the scenarios with the largest ones, and two replays in lockstep. */

import { ApiError, get, getAll, page } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { agentName, estimateCells, scale, verdict, whisker } from "../estimate.js";
import { isLost } from "../evaluation.js";
import { familyOf, sideScore } from "../families.js";
import { number, short, softwareText } from "../format.js";
import { unread } from "../notice.js";
import { goodness, shown } from "../scores.js";
import { colours } from "../subject.js";
import { copyButton, table } from "../table.js";
import { SIGNS, ending, meaning } from "../words.js";
import { load, play } from "../replay/player.js";

const PLAYED = 2; // replays side by side; more would be too small

const query = new URLSearchParams(location.search);

page(async () => {
  const ids = query.getAll("evaluation");
  if (ids.length < 2) {
    fill(
      byId("content"),
      h("h1", {}, "Compare"),
      h(
        "section",
        { class: "state" },
        h("h2", {}, "Choose what to compare"),
        h("p", {}, "Select two to eight finished evaluations of one benchmark version."),
        h("p", {}, h("a", { class: "button", href: "/evaluations" }, "to the evaluations")),
      ),
    );
    return;
  }
  const answer = await get(comparison(ids)).catch(refused);
  if (!answer) return;
  const given = { ...named(answer), family: familyOf(answer), score: sideScore(answer) };
  const colour = await colours(given.evaluations.map((one) => one.agent));
  fill(
    byId("content"),
    h(
      "div",
      { class: "title" },
      h("h1", {}, given.evaluations.map((one) => one.name).join(" and ")),
      h(
        "p",
        { class: "byline quiet" },
        `on ${given.benchmark}`,
        h("code", {}, short(given.benchmark_sha256)),
        h("a", { href: comparison(ids) }, "JSON"),
      ),
    ),
    scores(given, colour),
    pairs(given, colour),
    scenarios(given, colour),
    h("section", { id: "matrix" }),
    h("section", { id: "lockstep", hidden: true }),
  );
  await matrix(given);
  const chosen = given.scenarios.find((one) => key(one) === query.get("scenario"));
  if (chosen && given.family.replays) await watch(given, chosen, colour, false);
});

/** Gives each side a name: its agent, with the version where agents are equal, and its place where versions are too. */
function named(given) {
  const sides = given.evaluations;
  const distinct = (names, more) => names.map((name, i) => (names.filter((one) => one === name).length > 1 ? more(name, i) : name));
  const versioned = distinct(sides.map((one) => one.agent), (name, i) => `${name} v${sides[i].version}`);
  const names = distinct(versioned, (name, i) => `${name}, run ${i + 1}`);
  return { ...given, evaluations: sides.map((one, i) => ({ ...one, name: names[i] })) };
}

const pathOf = (agent) => `/agents/${encodeURIComponent(agent)}`;

function comparison(ids) {
  return `/v1/comparison?${ids.map((id) => `evaluation=${encodeURIComponent(id)}`).join("&")}`;
}

/** Says why the evaluations cannot be compared; any other error is raised again. */
function refused(error) {
  if (!(error instanceof ApiError) || ![400, 409, 422].includes(error.status)) throw error;
  fill(
    byId("content"),
    h("h1", {}, "Compare"),
    h(
      "section",
      { class: "state", role: "alert" },
      h("h2", {}, "These evaluations cannot be compared"),
      h("p", {}, error.message),
      h("p", {}, h("a", { class: "button", href: "/evaluations" }, "choose others")),
    ),
  );
  return null;
}

function scores(given, colour) {
  const columns = [
    {
      title: "agent",
      cell: (row) =>
        h(
          "a",
          { href: `/evaluations/${encodeURIComponent(row.evaluation)}` },
          agentName(row.name, colour[row.agent], null),
        ),
      csv: (row) => row.name,
    },
    ...shown(given.evaluations[0].scores, 5, given.metric).map(({ key, title, unit, top }) => ({
      title,
      unit,
      css: "estimate",
      head: scale(0, top),
      cell: (row) =>
        h("div", { style: { "--agent": colour[row.agent] ?? "var(--accent)" } }, whisker(row.scores[key], top)),
      csv: (row) => estimateCells(key, row.scores[key]),
    })),
    new Set(given.evaluations.map(softwareText)).size > 1 && { title: "driven with", cell: softwareText },
    given.evaluations.some((row) => row.lost > 0) && { title: "lost", unit: given.family.many, numeric: true, cell: (row) => row.lost },
  ].filter(Boolean);
  return h(
    "section",
    {},
    h("div", { class: "heading" }, h("h2", {}, "Scores"), copyButton(columns, given.evaluations)),
    h("div", { class: "panel wide" }, table(columns, given.evaluations, { name: "scores" })),
  );
}

function pairs(given, colour) {
  const sides = new Map(given.evaluations.map((one) => [one.evaluation, one]));
  const { one, many } = given.family;
  const linked = ({ name, agent }) => agentName(name, colour[agent], pathOf(agent));
  return h(
    "section",
    {},
    h("h2", {}, `Differences on the same ${many} (A minus B)`),
    h(
      "div",
      { class: "columns" },
      given.pairs.map((pair, place) => {
        const [a, b] = [sides.get(pair.a), sides.get(pair.b)];
        const rows = shown(pair.scores, 6, given.metric)
          .filter(({ key }) => pair.scores[key])
          .map((one) => ({ ...one, ...pair.scores[one.key] }));
        const columns = [
          { title: "score", cell: (row) => (row.lower ? `${row.title}, lower is better` : row.title), csv: (row) => row.key },
          {
            title: "difference",
            css: "estimate",
            cell: (row) => whisker(row.difference, row.top, { bottom: -row.top }),
            csv: (row) => estimateCells("difference", row.difference),
          },
          { title: "verdict", cell: (row) => verdict(row, `A: ${a.name}, B: ${b.name}`), csv: (row) => row.verdict },
        ];
        return h(
          "div",
          {},
          h(
            "div",
            { class: "heading sub" },
            h(
              "h3",
              {},
              linked(a),
              " minus ",
              linked(b),
            ),
            copyButton(columns, rows),
          ),
          rows.length
            ? h("div", { class: "panel wide" }, table(columns, rows, { name: `pair${place + 1}` }))
            : h("p", { class: "note" }, `No ${one} in common.`),
        );
      }),
    ),
    h(
      "p",
      { class: "note" },
      "A is the first agent, B the second. Axes run from the largest possible difference below 0 to that above 0. ",
      h("b", {}, "<"),
      " or ",
      h("b", {}, ">"),
      `: a test by flipped signs tells the mean from 0 at 5 %; it never does where fewer than six ${many} differ. P(A > B) is the probability that the score of A is higher, which is worse where lower is better.`,
    ),
  );
}

const key = (one) => `${one.scenario}-s${one.seed}`;

function scenarios(given, colour) {
  const { family, score } = given;
  if (!given.scenarios.length)
    return h(
      "section",
      {},
      h("h2", {}, "Where they differ most"),
      h("p", { class: "note" }, `No ${family.scenario} of all these agents differs in this score.`),
    );
  const columns = [
    { title: family.scenario, cell: (row) => row.scenario },
    { title: "seed", numeric: true, cell: (row) => row.seed },
    ...given.evaluations.map((one, i) => ({
      title: one.name,
      unit: `${score.name}, ${score.unit}`,
      key: one.name,
      css: "named",
      cell: (row) =>
        h(
          "a",
          { href: `/episodes/${encodeURIComponent(row.episodes[i])}`, class: "outcome" },
          number(score.of(row)[i]),
          " ",
          how(row.statuses?.[i]),
        ),
      csv: (row) => score.of(row)[i],
    })),
    { title: "spread", numeric: true, cell: (row) => number(row.spread) },
    family.replays && {
      title: "replays",
      csv: null,
      cell: (row) => h("button", { type: "button", click: () => watch(given, row, colour) }, "side by side"),
    },
  ].filter(Boolean);
  return h(
    "section",
    {},
    h("div", { class: "heading" }, h("h2", {}, "Where they differ most"), copyButton(columns, given.scenarios)),
    h("div", { class: "panel wide" }, table(columns, given.scenarios, { name: "scenarios" })),
  );
}

/** Missions or days by agents: the mean score over seeds; the better, the stronger the shade. */
async function matrix({ evaluations, family, score }) {
  if (!family.mission) return;
  const heading = family.mission === "day" ? "Days by agents" : "Missions by agents";
  const sides = await Promise.all(
    evaluations.map((one) => getAll(`/v1/evaluations/${encodeURIComponent(one.evaluation)}/episodes`)),
  ).catch((failure) => ({ failure }));
  if (sides.failure) return fill(byId("matrix"), unread(heading, sides.failure));
  const scoresOf = (side, mission) =>
    side
      .filter((one) => one.scenario === mission && one.status === "done" && !isLost(one))
      .flatMap(score.ofEgos);
  const mean = (scores) => (scores.length ? scores.reduce((sum, one) => sum + one, 0) / scores.length : null);
  const missions = [...new Set(sides.flat().map((one) => one.scenario))];
  const rows = missions.map((mission) => ({ mission, scores: sides.map((side) => scoresOf(side, mission)) }));
  if (!rows.length) return;
  const columns = [
    { title: family.mission, cell: (row) => row.mission, csv: (row) => row.mission },
    ...evaluations.map((one, i) => ({
      title: `${one.agent} v${one.version}`,
      unit: `${score.name}, ${score.unit}`,
      key: `${one.agent}-${i + 1}`,
      numeric: true,
      css: "shaded named",
      cell: (row) => shaded(mean(row.scores[i]), row.scores[i].length, score),
      csv: (row) => mean(row.scores[i]) ?? "",
    })),
  ];
  fill(
    byId("matrix"),
    h("div", { class: "heading" }, h("h2", {}, heading), copyButton(columns, rows)),
    h("div", { class: "panel wide" }, table(columns, rows, { name: "missions", caption: heading })),
    h("p", { class: "note" }, `Mean of each ${family.mission} over its seeds; the better, the stronger the shade.`),
  );
}

const shaded = (value, n, score) =>
  h(
    "span",
    { class: "shade", style: { "--share": 0.4 * goodness(value, score) }, title: `n=${n}` },
    number(value),
    h("span", { class: "quiet" }, ` n=${n}`),
  );

function how(statuses) {
  if (!statuses?.length) return "";
  const status = statuses.find((one) => meaning(one) !== "success") ?? statuses[0];
  return h(
    "span",
    { class: `status ${meaning(status)} small` },
    h("i", { "aria-hidden": "true" }, SIGNS[meaning(status)]),
    ending(status),
  );
}

let watched = new AbortController(); // of the replays that are shown, or being read

/** Shows the first two replays of a scenario in lockstep, in place of those shown before; the address keeps the scenario. */
async function watch(given, scenario, colour, move = true) {
  const section = byId("lockstep");
  watched.abort();
  const { signal } = (watched = new AbortController());
  if (move) {
    query.set("scenario", key(scenario));
    history.replaceState(null, "", `?${query}`);
  }
  section.hidden = false;
  fill(
    section,
    h("h2", {}, `${scenario.scenario}, seed ${scenario.seed}, side by side`),
    h("p", { class: "loading", role: "status" }, "Reading both replays …"),
  );
  section.scrollIntoView();
  const theatre = h("div", { class: "theatre" });
  const loaded = await Promise.all(scenario.episodes.slice(0, PLAYED).map(load)).catch((error) => {
    if (!signal.aborted) section.lastChild.replaceWith(noReplays(error));
  });
  if (!loaded || signal.aborted) return;
  section.lastChild.replaceWith(theatre);
  play(
    theatre,
    loaded.map((one, i) => ({ ...one, agent: given.evaluations[i].name, title: title(given, scenario, i, colour) })),
    signal,
  );
  theatre.querySelector("canvas").focus({ preventScroll: true });
}

const noReplays = (error) => h("p", { class: "problem", role: "alert" }, `The replays could not be read: ${error.message}`);

function title(given, scenario, i, colour) {
  const { agent, name } = given.evaluations[i];
  const { score } = given;
  return h(
    "span",
    {},
    agentName(name, colour[agent], null),
    h("span", { class: "quiet" }, `  ${score.name} ${number(score.of(scenario)[i])} ${score.unit}  `),
    h("a", { href: `/episodes/${encodeURIComponent(scenario.episodes[i])}` }, "open replay"),
  );
}
