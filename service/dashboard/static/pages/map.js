/** Map of an evaluation's infractions, by kind; marks that overlap are counted. A mark opens the replay 5 s earlier. */

import { get, page } from "../api.js";
import { byId, fill, h, mark } from "../dom.js";
import { missing } from "../estimate.js";
import { number, seconds } from "../format.js";
import { subject } from "../subject.js";
import { copyButton, renewed, table } from "../table.js";
import { turns } from "../turns.js";
import { fault, infractionText, label, words } from "../words.js";
import { GroundMap } from "../replay/ground.js";
import { roads } from "../replay/player.js";

const BEFORE_S = 5;
const AROUND_M = 80;

const id = subject();
let drawn = new AbortController(); // of the map that is shown

page(async () => {
  const base = `/v1/evaluations/${encodeURIComponent(id)}`;
  const [evaluation, given] = await Promise.all([get(base), get(`${base}/infractions`)]);
  const all = given.infractions;
  const networks = [...new Set(all.map((one) => one.network))].sort();
  const place = h("div", {});
  const list = h("div", {});
  const began = turns();
  const choice = h(
    "select",
    { "aria-label": "network", change: () => show(choice.value) },
    networks.map((name) => h("option", { value: name }, name)),
  );
  fill(
    byId("content"),
    h(
      "div",
      { class: "title" },
      h(
        "p",
        { class: "crumbs quiet" },
        h("a", { href: `/evaluations/${encodeURIComponent(id)}` }, "evaluation"),
        " / map",
      ),
      h("h1", {}, `Infractions of ${evaluation.agent}`),
      h(
        "p",
        { class: "byline quiet" },
        `on ${evaluation.benchmark}`,
        networks.length > 1 && choice,
        h("a", { href: `${base}/infractions` }, "JSON"),
      ),
    ),
    place,
  );
  if (!all.length) {
    fill(
      place,
      h(
        "section",
        { class: "state" },
        h("h2", {}, "No infraction"),
        h("p", {}, "No infraction happened in the episodes that have ended."),
      ),
    );
    return;
  }
  const show = async (network) => {
    const isLast = began();
    const infractions = all.filter((one) => one.network === network);
    const box = boundsOf(infractions);
    const map = await roads(network, box);
    if (isLast()) draw(place, list, network, infractions, box, map);
  };
  await show(networks[0]);
});

function draw(place, list, network, infractions, box, map) {
  const kinds = Object.keys(words.marks).filter((kind) => infractions.some((one) => one.kind === kind));
  const hidden = new Set();
  const canvas = h("canvas", {
    class: "stage",
    role: "img",
    tabindex: 0,
    "aria-label": `Map of ${network} with ${infractions.length} infractions. Arrow keys move it, plus and minus zoom. The same infractions are in the table below.`,
  });
  const legend = h(
    "fieldset",
    { class: "legend", "aria-label": "Kinds of infraction shown" },
    kinds.map((kind) =>
      h(
        "label",
        {},
        h("input", {
          type: "checkbox",
          checked: true,
          change: (event) => {
            hidden[event.target.checked ? "delete" : "add"](kind);
            update();
          },
        }),
        mark(kind, words.marks[kind].path),
        label(kind),
        h("span", { class: "quiet number" }, String(infractions.filter((one) => one.kind === kind).length)),
      ),
    ),
  );
  const tip = h("div", { class: "tip", hidden: true, "aria-hidden": "true" });
  const tools = h("div", { class: "tools", role: "toolbar", "aria-label": "View of the map" });
  fill(
    place,
    h(
      "div",
      { class: "panel" },
      legend,
      h(
        "div",
        { class: "ground" },
        canvas,
        tools,
        tip,
        map.missing && h("p", { class: "note bare" }, `The roads are missing: ${map.missing}`),
      ),
    ),
    list,
  );
  drawn.abort();
  drawn = new AbortController();
  const ground = new GroundMap(canvas, map, box, { tip, describe, open }, drawn.signal);
  tools.append(
    h("button", { type: "button", "aria-label": "zoom in", click: () => ground.zoom(1.6) }, "+"),
    h("button", { type: "button", "aria-label": "zoom out", click: () => ground.zoom(1 / 1.6) }, "−"),
    h("button", { type: "button", click: () => ground.fit(box) }, "all"),
  );
  const update = () => {
    const shown = infractions.filter((one) => !hidden.has(one.kind));
    ground.show(shown);
    showList(list, shown);
  };
  update();
}

function boundsOf(infractions) {
  const xs = infractions.map((one) => one.x_m);
  const ys = infractions.map((one) => one.y_m);
  return [
    Math.min(...xs) - AROUND_M,
    Math.min(...ys) - AROUND_M,
    Math.max(...xs) + AROUND_M,
    Math.max(...ys) + AROUND_M,
  ];
}

const replayOf = (one) =>
  `/episodes/${encodeURIComponent(one.episode)}#t=${Math.max(0, one.time_s - BEFORE_S).toFixed(1)}`;

const open = (one) => location.assign(replayOf(one));

function describe(cluster) {
  const [one] = cluster.items;
  if (cluster.items.length > 1) return `${cluster.items.length} × ${label(one.kind)}: press to zoom in`;
  return `${infractionText(one)} · ${one.scenario}, seed ${one.seed}: press to open the replay`;
}

function showList(place, infractions) {
  const columns = [
    {
      title: "kind",
      choice: true,
      cell: (row) =>
        h(
          "span",
          { class: "with-mark" },
          mark(row.kind, words.marks[row.kind].path, row.at_fault === false),
          label(row.kind),
        ),
      csv: (row) => row.kind,
    },
    {
      title: "fault",
      choice: true,
      cell: (row) => fault(row) || missing("only collisions are judged; those of earlier versions were not"),
      csv: (row) => fault(row) || "not judged",
    },
    { title: "scenario", cell: (row) => h("a", { href: replayOf(row) }, row.scenario), csv: (row) => row.scenario },
    { title: "seed", numeric: true, cell: (row) => row.seed },
    { title: "time", unit: "s", numeric: true, cell: (row) => seconds(row.time_s), csv: (row) => row.time_s },
    {
      title: "along the route",
      unit: "m",
      numeric: true,
      cell: (row) => number(row.route_m),
      csv: (row) => row.route_m,
    },
    { title: "cell", choice: true, cell: (row) => row.cell },
  ];
  const heading = `${infractions.length} infractions`;
  if (renewed(place, columns, infractions)) {
    place.querySelector("h2").textContent = heading;
    return;
  }
  fill(
    place,
    h(
      "section",
      {},
      h("div", { class: "heading" }, h("h2", {}, heading), copyButton(columns, infractions)),
      h("div", { class: "panel wide" }, table(columns, infractions, { name: "infractions" })),
    ),
  );
}
