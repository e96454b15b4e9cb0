/** The worlds of the token's owner, live ones first. */

import { getAll, page } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { moment, seconds } from "../format.js";
import { madeBy } from "../live/instructions.js";
import { standing } from "../live/standing.js";
import { copyButton, table } from "../table.js";

const MOST = 500;

page(async () => {
  const rows = (await getAll("/v1/worlds", MOST)).sort(
    (a, b) => Boolean(a.finished) - Boolean(b.finished) || (a.created < b.created ? 1 : -1),
  );
  const title = h("h1", {}, "Worlds");
  const lead = h("p", { class: "lead" }, "Live scenarios in which several workers drive, each with its own egos.");
  if (!rows.length) {
    fill(
      byId("content"),
      title,
      lead,
      h(
        "section",
        { class: "state" },
        h("h2", {}, "No world yet"),
        h("p", {}, "This command makes one; its answer has the identifier that workers join by:"),
        madeBy(),
      ),
    );
    return;
  }
  const columns = [
    {
      title: "world",
      cell: (row) => h("a", { href: `/worlds/${encodeURIComponent(row.id)}` }, row.scenario, " ", h("code", { class: "quiet" }, row.id)),
      csv: (row) => row.id,
    },
    { title: "status", choice: true, cell: (row) => standing(row.status), csv: (row) => row.status },
    { title: "network", choice: true, cell: (row) => row.network },
    { title: "seed", numeric: true, cell: (row) => String(row.seed) },
    {
      title: "egos with a driver",
      numeric: true,
      sort: driven,
      cell: (row) => (row.finished ? "—" : `${driven(row)} of ${row.egos.length}`),
      csv: (row) => ({ driven: driven(row), egos: row.egos.length }),
    },
    { title: "time", unit: "s", numeric: true, sort: (row) => row.time_s, cell: (row) => seconds(row.time_s), csv: (row) => row.time_s },
    { title: "record", choice: true, cell: (row) => (row.record_hash ? "yes" : row.recorded && !row.finished ? "at its end" : "no") },
    { title: "created", cell: (row) => h("time", {}, moment(row.created)), csv: (row) => row.created },
  ];
  fill(
    byId("content"),
    h("div", { class: "heading" }, title, copyButton(columns, rows)),
    lead,
    h("div", { class: "panel wide" }, table(columns, rows, { name: "worlds", caption: "Worlds" })),
    h("section", {}, h("h2", {}, "Make a world"), madeBy()),
  );
});

const driven = (row) => row.egos.filter((ego) => ego.driver).length;
