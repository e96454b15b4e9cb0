/** Ranking of the agents on one benchmark version, by track. */

import { get, page } from "../api.js";
import { columnsOf, kindsOn, partText, readBoard, versionText } from "../board.js";
import { crossPlay } from "../cross_play.js";
import { byId, fill, h, mark } from "../dom.js";
import { FAMILIES } from "../families.js";
import { short } from "../format.js";
import { startCommand, startText } from "../start.js";
import { colours } from "../subject.js";
import { copyButton, table } from "../table.js";
import { label, words } from "../words.js";

const FIRST = "quickstart"; // the smallest benchmark of drives
const TRACKS = ["", "sensors", "map", "privileged"];

page(async () => {
  const query = new URLSearchParams(location.search);
  const benchmarks = await get("/v1/benchmarks");
  const name = query.get("benchmark") ?? (await firstDriven(benchmarks)) ?? FIRST;
  const asked = new URLSearchParams({ benchmark: name });
  for (const key of ["version", "track"]) if (query.get(key)) asked.set(key, query.get(key));
  const board = await readBoard(asked);
  const { rows } = board;
  const colour = await colours(rows.map((row) => row.agent));
  const columns = columnsOf(rows, board.metric ?? "driving_score", colour);
  const benchmark = benchmarks.find((one) => one.name === name);
  fill(
    byId("content"),
    h(
      "div",
      { class: "title" },
      h("h1", {}, "Leaderboard"),
      h("p", { class: "lead quiet" }, benchmark?.description ?? name),
    ),
    filters(benchmarks, board.versions, name, query, rows.length ? copyButton(columns, rows) : null),
    rows.length
      ? [
          h("div", { class: "panel wide" }, table(columns, rows, { name: "board", css: "board", caption: `Leaderboard of ${name}` })),
          notes(board, rows, asked),
        ]
      : empty(name, benchmarks, query.get("track")),
    benchmark?.egos.length > 0 && (await crossPlay(name, benchmark.egos, board.version)),
  );
});

/** The benchmark of a finished evaluation, else quickstart. */
async function firstDriven(benchmarks) {
  const done = await get("/v1/evaluations?status=done&limit=1").catch(() => null);
  return done?.items[0]?.benchmark ?? benchmarks.find((one) => one.name === FIRST)?.name;
}

function filters(benchmarks, versions, name, query, copy) {
  const go = (key, value) => {
    const next = new URLSearchParams(location.search);
    if (value) next.set(key, value);
    else next.delete(key);
    if (key === "benchmark") next.delete("version");
    location.search = next;
  };
  const choice = (title, key, options, chosen) =>
    h(
      "label",
      {},
      title,
      h(
        "select",
        { name: key, change: (event) => go(key, event.target.value) },
        options.map(([value, text]) => h("option", { value, selected: value === chosen }, text)),
      ),
    );
  const names = [...new Set([name, ...benchmarks.map((one) => one.name)])].sort();
  return h(
    "div",
    { class: "filters" },
    choice(
      "benchmark",
      "benchmark",
      names.map((one) => [one, one]),
      name,
    ),
    versions.length > 1 &&
      choice(
        "version",
        "version",
        versions.map((one, i) => [one, i ? short(one) : `${short(one)} newest`]),
        query.get("version") ?? versions[0],
      ),
    choice(
      "track",
      "track",
      TRACKS.map((one) => [one, one || "all"]),
      query.get("track") ?? "",
    ),
    copy,
  );
}

function notes(board, rows, asked) {
  const kinds = kindsOn(rows);
  const several = rows.slice(0, 4);
  return h(
    "div",
    { class: "under" },
    kinds.length > 0 &&
      h(
        "p",
        { class: "note key" },
        "bars, left to right: ",
        kinds.map((kind) => h("span", {}, mark(kind, words.marks[kind].path), label(kind))),
      ),
    h(
      "p",
      { class: "note" },
      partText(board),
      versionText(rows),
      `Ranked by ${board.description}. `,
      "Rows without a significant difference on the same drives share a rank. Vs above: the paired test of this row (A) against the row above (B); P(A better) is the probability that A is better. ",
      "Version ",
      h("code", {}, short(board.version)),
      ".",
    ),
    h(
      "p",
      { class: "links" },
      several.length > 1 && [
        h(
          "a",
          { href: `/compare?${several.map((row) => `evaluation=${encodeURIComponent(row.evaluation)}`).join("&")}` },
          several.length === 2 ? "compare the two" : `compare the first ${several.length}`,
        ),
        " · ",
      ],
      h("a", { href: `/v1/leaderboard?${asked}` }, "JSON"),
      " · ",
      h("a", { href: `/v1/leaderboard.csv?${asked}` }, "CSV"),
    ),
  );
}

/** An empty board: how to fill it, and in how many drives. */
function empty(name, benchmarks, track) {
  const find = (wanted) => benchmarks.find((one) => one.name === wanted);
  const [benchmark, first] = [find(name), find(FIRST)];
  const family = benchmark?.kind ?? "driving";
  return h(
    "section",
    { class: "state" },
    h("h2", {}, track ? `No agent on the ${track} track yet` : `No finished evaluation of ${name} yet`),
    h("p", {}, startText(family, benchmark ? drivesOf(benchmark) : FAMILIES[family].many)),
    startCommand(name, family),
    family === "driving" &&
      first &&
      name !== FIRST &&
      h("p", {}, "For a first try, ", h("a", { href: `/?benchmark=${FIRST}` }, FIRST), ` has ${drivesOf(first)}.`),
    h(
      "p",
      { class: "quiet" },
      h("code", {}, "TOKEN"),
      ": yours, from ",
      h("code", {}, "dohyo tokens create"),
      " or the organiser. Running evaluations are listed under ",
      h("a", { href: "/evaluations" }, "evaluations"),
      "; the HTTP interface is explained under ",
      h("a", { href: "/api" }, "API"),
      ".",
    ),
  );
}

/** What a run consists of, such as "18 drives (6 scenarios, 3 seeds)". */
function drivesOf({ kind, scenarios, seeds, egos }) {
  const { one, many, scenario } = FAMILIES[kind];
  const counted = (number, single, several) => `${number.toLocaleString("en")} ${number === 1 ? single : several}`;
  const factors = [
    [scenarios, scenario],
    [seeds.length, "seed"],
    [kind === "driving" ? egos.length || 1 : 1, "ego"], // each ego's part of an episode is a drive
  ];
  const total = counted(factors.reduce((product, [number]) => product * number, 1), one, many);
  const told = factors.filter(([number]) => number > 1).map(([number, name]) => counted(number, name, `${name}s`));
  return told.length > 1 ? `${total} (${told.join(", ")})` : total;
}
