/** The league: dohyo's own systems in parts of benchmarks, on seeds that were fixed before the first drive. */

import { get, page } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { estimateCells, missing, scale, whisker } from "../estimate.js";
import { FAMILIES } from "../families.js";
import { interval, number } from "../format.js";
import { colours } from "../subject.js";
import { copyButton, table } from "../table.js";

const PERCENT = 100; // upper end of the axis of scores that are shares

const LEADERS = [
  { title: "discipline", cell: (one) => h("a", { href: `#${one.name}` }, one.title), csv: (one) => one.name },
  { title: "leads", cell: (one) => names(first(one)), csv: (one) => names(first(one)) },
  {
    title: "score",
    numeric: true,
    cell: (one) => [h("b", {}, number(headlineOf(one, one.places[0]).mean)), h("div", { class: "quiet small" }, one.measures[0].title)],
    csv: (one) => headlineOf(one, one.places[0]).mean,
  },
  {
    title: "not significantly behind",
    css: "plain",
    cell: (one) => names(close(one)) || "nobody",
    csv: (one) => close(one).length,
  },
];

page(async () => {
  const { edition, versions, told, looked_at, disciplines } = await get("/v1/league");
  const entrants = disciplines.flatMap((one) => one.places.map((place) => place.entrant));
  const colour = await colours([...new Set(entrants)]);
  const driven = disciplines.filter((one) => one.places.length);
  const open = disciplines.filter((one) => !one.places.length);
  fill(
    byId("content"),
    h("div", { class: "title" }, h("h1", {}, "League"), h("p", { class: "quiet" }, `edition ${edition}, driven with dohyo ${versions.join(" and ")}`)),
    h(
      "p",
      {},
      `${told} In bold stands who leads a discipline, and who is not significantly behind. `,
      "With few drives this includes entrants that drive clearly worse, so read the numbers, too. ",
      "Numbers of the sources were measured in other simulators: to be seen, not to be compared.",
    ),
    h("div", { class: "panel wide" }, table(LEADERS, driven, { name: "leaders", caption: "Who leads where" })),
    driven.map((one) => section(one, colour)),
    h(
      "section",
      { class: "prose" },
      h("h2", {}, "Seeds"),
      h("p", {}, "They were fixed before the first drive."),
      h("ul", {}, looked_at.map((one) => h("li", {}, one))),
    ),
    open.length > 0 && h("p", { class: "note" }, `Not driven so far: ${open.map((one) => one.title).join("; ")}.`),
  );
});

const headlineOf = (discipline, place) => place.scores[discipline.measures[0].key];
const isFirst = (discipline, place) => headlineOf(discipline, place).mean === headlineOf(discipline, discipline.places[0]).mean;

/** Places with the best mean, which several may share. */
const first = (discipline) => discipline.places.filter((place) => isFirst(discipline, place));

/** Places below these that are not significantly behind. */
const close = (discipline) => discipline.places.filter((place) => place.leads && !isFirst(discipline, place));

const names = (places) => places.map((place) => place.entrant).join(", ");

/** One discipline: its places, the best first. */
function section(discipline, colour) {
  const [headline, ...beside] = discipline.measures;
  const top = axis(discipline, headline);
  const columns = [
    {
      title: "entrant",
      cell: (place) => [
        place.leads ? h("b", {}, place.entrant) : h("span", { class: "plain" }, place.entrant),
        h("div", { class: "quiet small plain" }, place.thesis ? `${place.system} · thesis ${place.thesis}` : place.system),
      ],
      csv: (place) => ({ entrant: place.entrant, system: place.system }),
    },
    {
      title: headline.title,
      css: "estimate",
      head: scale(0, top),
      cell: (place) => h("div", { style: { "--agent": colour[place.entrant] ?? "var(--accent)" } }, whisker(place.scores[headline.key], top)),
      csv: (place) => estimateCells(headline.key, place.scores[headline.key]),
    },
    ...beside.map((measure) => ({
      title: measure.title,
      numeric: true,
      cell: (place) => told(place.scores[measure.key]),
      csv: (place) => estimateCells(measure.key, place.scores[measure.key]),
    })),
    { title: "better than", css: "plain small", cell: (place) => place.better_than.join(", ") || "nobody", csv: (place) => ({ better_than: place.better_than.length }) },
    { title: FAMILIES[discipline.family].many, numeric: true, cell: (place) => counted(place), csv: (place) => ({ counted: place.counted }) },
    { title: "decision", unit: "ms", numeric: true, cell: (place) => (place.decision_ms === null ? missing("not measured in this discipline") : number(place.decision_ms)), csv: (place) => ({ decision_ms: place.decision_ms }) },
    { title: "its source says", css: "plain small quiet", cell: (place) => place.reported ?? missing("its source reports no such number"), csv: (place) => ({ reported: place.reported ?? "" }) },
  ];
  return h(
    "section",
    { id: discipline.name, "aria-label": discipline.title },
    h("div", { class: "heading" }, h("h2", {}, discipline.title), copyButton(columns, discipline.places)),
    h("p", { class: "quiet" }, `${discipline.told} Benchmark ${discipline.benchmark}${headline.lower ? "; lower is better" : ""}.`),
    h("div", { class: "panel wide" }, table(columns, discipline.places, { name: discipline.name, caption: discipline.title })),
  );
}

/** Upper end of the headline's axis. */
function axis(discipline, headline) {
  if (!headline.lower) return PERCENT;
  return Math.max(...discipline.places.map((place) => place.scores[headline.key].high ?? place.scores[headline.key].mean ?? 0));
}

function told(estimate) {
  if (!estimate || estimate.mean === null) return missing("none counts");
  return [h("b", { class: "number" }, number(estimate.mean)), h("div", { class: "quiet number" }, interval(estimate))];
}

const counted = (place) => (place.lost ? `${place.counted}, ${place.lost} lost` : `${place.counted}`);
