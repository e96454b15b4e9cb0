/** All evaluations, the newest first; two to eight of one benchmark version can be compared. */

import { getAll, page } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { agentName } from "../estimate.js";
import { bar, standing } from "../evaluation.js";
import { moment, short } from "../format.js";
import { agentsOf, driversOf, isMixed } from "../mixed.js";
import { startCommand, startText } from "../start.js";
import { colours } from "../subject.js";
import { copyButton, table } from "../table.js";

const MOST = 500;

page(async () => {
  const rows = (await getAll("/v1/evaluations", MOST)).sort((a, b) => (a.created < b.created ? 1 : -1));
  const colour = await colours(rows.flatMap(agentsOf));
  const title = h("h1", {}, "Evaluations");
  if (!rows.length) {
    fill(
      byId("content"),
      title,
      h(
        "section",
        { class: "state" },
        h("h2", {}, "No evaluation yet"),
        h("p", {}, startText("driving", "a few drives")),
        startCommand("quickstart"),
      ),
    );
    return;
  }
  const compare = h("button", { type: "submit", disabled: true }, "compare");
  const columns = [
    {
      title: "agent",
      cell: (row) => driversOf(row).map(({ agent }) => h("div", {}, agentName(agent, colour[agent]))),
      csv: (row) => driversOf(row).map(({ agent }) => agent).join(" "),
    },
    {
      title: "version",
      numeric: true,
      cell: (row) => driversOf(row).map(({ version }) => h("div", {}, String(version))),
      csv: (row) => driversOf(row).map(({ version }) => version).join(" "),
    },
    {
      title: "benchmark",
      choice: true,
      cell: (row) => [
        row.benchmark,
        " ",
        h("code", { class: "quiet", title: row.benchmark_version }, short(row.benchmark_version)),
      ],
      csv: (row) => row.benchmark,
    },
    { title: "status", choice: true, cell: (row) => standing(row.status), csv: (row) => row.status },
    {
      title: "episodes",
      css: "estimate",
      sort: (row) => row.progress.done,
      cell: (row) =>
        h(
          "div",
          { class: "counted" },
          bar(row.progress, "episodes done"),
          h("span", { class: "number quiet" }, `${row.progress.done} / ${row.progress.total}`),
        ),
      csv: (row) => row.progress,
    },
    {
      title: "created",
      cell: (row) => h("a", { href: `/evaluations/${encodeURIComponent(row.id)}` }, h("time", {}, moment(row.created))),
      csv: (row) => row.created,
    },
    {
      title: "compare",
      csv: null,
      cell: (row) =>
        h("input", {
          type: "checkbox",
          name: "evaluation",
          value: row.id,
          disabled: row.status !== "done" || isMixed(row),
          title: isMixed(row) ? "a mixed run: its scores are by agent" : null,
          "aria-label": `compare ${row.agent}, ${moment(row.created)}`,
        }),
    },
  ];
  const form = h(
    "form",
    { method: "get", action: "/compare" },
    h("div", { class: "panel wide" }, table(columns, rows, { name: "evaluations", caption: "Evaluations" })),
    h(
      "p",
      { class: "links" },
      compare,
      h("span", { class: "quiet" }, " select two to eight finished evaluations of one benchmark version; mixed runs are not compared"),
    ),
  );
  form.addEventListener("change", () => {
    const chosen = form.querySelectorAll("input:checked").length;
    compare.disabled = chosen < 2 || chosen > 8;
  });
  fill(byId("content"), h("div", { class: "heading" }, title, copyButton(columns, rows)), form);
});
