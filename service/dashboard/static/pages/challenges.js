/** All challenges, with the state of their phases; organisers make new ones here. */

import { get, getAll, page, send } from "../api.js";
import { command } from "../command.js";
import { byId, fill, h } from "../dom.js";
import { field, form, input } from "../forms.js";
import { countdown, nextMoment, stateOf } from "../phases.js";
import { table } from "../table.js";

page(async () => {
  const [challenges, me] = await Promise.all([getAll("/v1/challenges"), get("/v1/me").catch(() => null)]);
  fill(
    byId("content"),
    h(
      "div",
      { class: "heading" },
      h("h1", {}, "Challenges"),
      h("a", { class: "button", href: "/join" }, "take part with an invitation"),
    ),
    challenges.length
      ? h("div", { class: "panel wide" }, table(columns, challenges, { name: "challenges", caption: "Challenges" }))
      : h(
          "section",
          { class: "state" },
          h("h2", {}, "No challenge yet"),
          h("p", {}, "An organiser makes the first one. A token of role organiser is made with:"),
          command("dohyo tokens create --owner NAME --role organiser"),
        ),
    ["organiser", "admin"].includes(me?.role) && making(),
  );
});

const current = (one) => one.phases.find((phase) => phase.state === "open") ?? one.phases.find((phase) => phase.state !== "final");

const columns = [
  {
    title: "challenge",
    cell: (row) => [
      h("a", { href: `/challenges/${encodeURIComponent(row.name)}` }, row.title),
      h("div", { class: "quiet small plain" }, `by ${row.organiser}`),
    ],
    csv: (row) => row.title,
  },
  {
    title: "phase",
    cell: (row) => {
      const phase = current(row) ?? row.phases.at(-1);
      return phase ? [phase.name, " ", stateOf(phase)] : h("span", { class: "quiet" }, "none yet");
    },
    csv: (row) => (current(row) ?? row.phases.at(-1))?.state ?? "",
  },
  {
    title: "next",
    cell: (row) => {
      const [name, at] = nextMoment(current(row) ?? {}) ?? [];
      return at ? [`${name} in `, countdown(at)] : h("span", { class: "quiet" }, "—");
    },
    csv: (row) => nextMoment(current(row) ?? {})?.[1] ?? "",
  },
  { title: "teams", numeric: true, cell: (row) => row.teams, csv: (row) => row.teams },
  { title: "your team", cell: (row) => row.my_team ?? h("span", { class: "quiet" }, "—"), csv: (row) => row.my_team ?? "" },
];

function making() {
  return h(
    "section",
    {},
    h("h2", {}, "Make a challenge"),
    h(
      "div",
      { class: "panel" },
      form(
        [
          field("Name", "name", input("text", { required: true, maxlength: 100, pattern: "[a-z0-9][a-z0-9\\-]*" }), "Part of its address; it can never be changed. Small letters, digits and hyphens."),
          field("Title", "title", input("text", { required: true, maxlength: 200 })),
          field("Rules", "rules", h("textarea", { rows: 8, maxlength: 100_000 }), "Headings with #, lists with -, **bold**, `code` and [links](https://…)."),
        ],
        "make the challenge",
        async (values) => {
          const made = await send("POST", "/v1/challenges", Object.fromEntries(values));
          location.assign(`/challenges/${encodeURIComponent(made.name)}/organise`);
        },
      ),
    ),
  );
}
