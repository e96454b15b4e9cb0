/** The reader's account: who one is, agents, and tokens: made, shown once, revoked. */

import { get, getAll, page, send } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { confirmed, field, form, input, select, shownOnce } from "../forms.js";
import { moment } from "../format.js";
import { table } from "../table.js";

const ROLES = ["reader", "worker", "submitter", "organiser", "admin"]; // each has the permissions of those before
const SAYS = { reader: "reads", worker: "drives", submitter: "submits and orders", organiser: "organises", admin: "administers" };

page(async () => {
  const [me, agents] = await Promise.all([get("/v1/me"), getAll("/v1/agents")]);
  fill(
    byId("content"),
    h("div", { class: "title" }, h("h1", {}, me.owner), h("p", { class: "byline quiet" }, `signed in with a token of role ${me.role}`)),
    h("section", { id: "tokens" }),
    agentPart(agents.filter((one) => one.owner === me.owner)),
  );
  await showTokens(me);
});

async function showTokens(me, fresh = null) {
  const rows = (await getAll("/v1/tokens")).filter((one) => one.owner === me.owner);
  const state = (row) => (row.revoked ? "revoked" : row.expires && new Date(row.expires) < new Date() ? "expired" : "valid");
  const columns = [
    { title: "token", cell: (row) => [h("code", {}, row.id), row.id === me.token && h("span", { class: "quiet small plain" }, " this session")], csv: (row) => row.id },
    { title: "role", choice: true, cell: (row) => row.role, csv: (row) => row.role },
    { title: "state", choice: true, cell: state, csv: state },
    { title: "created", cell: (row) => h("time", {}, moment(row.created)), csv: (row) => row.created },
    { title: "expires", cell: (row) => (row.expires ? h("time", {}, moment(row.expires)) : h("span", { class: "quiet" }, "never")), csv: (row) => row.expires ?? "" },
    {
      title: "revoke",
      csv: null,
      cell: (row) => (state(row) === "valid" ? confirmed("revoke", "really revoke", "DELETE", `/v1/tokens/${encodeURIComponent(row.id)}`, () => showTokens(me)) : ""),
    },
  ];
  const allowed = ROLES.slice(0, ROLES.indexOf(me.role) + 1);
  const making = form(
    [
      field("Role", "role", select(allowed.map((role) => [role, `${role}: ${SAYS[role]}`]), allowed.includes("worker") ? "worker" : allowed[0]), "The least that its use needs: a worker on another machine needs worker."),
      field("Valid for days", "expires_in_days", input("number", { min: 0.01, max: 3650, step: "any", placeholder: "no end" })),
    ],
    "make a token",
    async (values) => {
      const order = { role: values.get("role") };
      if (values.get("expires_in_days")) order.expires_in_days = Number(values.get("expires_in_days"));
      await showTokens(me, await send("POST", "/v1/tokens", order));
    },
  );
  making.classList.add("in-line");
  fill(
    byId("tokens"),
    h("h2", {}, "Tokens"),
    h("div", { class: "panel" }, making),
    fresh && shownOnce(`New token of role ${fresh.role}`, fresh.token, "Copy it now: it cannot be shown again."),
    h("div", { class: "panel wide" }, table(columns, rows, { name: "tokens", caption: "Tokens" })),
  );
}

function agentPart(agents) {
  const columns = [
    { title: "agent", css: "named", cell: (row) => h("a", { href: `/agents/${encodeURIComponent(row.name)}` }, row.name), csv: (row) => row.name },
    { title: "version", numeric: true, cell: (row) => row.version ?? "—", csv: (row) => row.version ?? "" },
    { title: "kind", choice: true, cell: (row) => row.kind ?? "—", csv: (row) => row.kind ?? "" },
    { title: "track", choice: true, cell: (row) => row.track ?? "—", csv: (row) => row.track ?? "" },
    { title: "created", cell: (row) => h("time", {}, moment(row.created)), csv: (row) => row.created },
  ];
  return h(
    "section",
    {},
    h("div", { class: "heading" }, h("h2", {}, "Agents"), h("a", { class: "button", href: "/submit" }, "submit an agent")),
    agents.length ? h("div", { class: "panel wide" }, table(columns, agents, { name: "agents", caption: "Agents" })) : h("p", { class: "note" }, "No agent yet."),
  );
}
