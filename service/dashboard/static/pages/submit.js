/** Submits an agent: an ONNX file, a built-in agent, or a remote one that drives through its owner's workers. */

import { get, getAll, page, send } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { field, form, input, select } from "../forms.js";

const NEW = ""; // the choice of a new agent
const SENSORS = { sensors: "speedometer", map: "speedometer, route", privileged: "speedometer, route" };

page(async () => {
  const [me, agents, described] = await Promise.all([get("/v1/me"), getAll("/v1/agents"), get("/v1/observations")]);
  const mine = agents.filter((one) => one.owner === me.owner);
  const challenge = new URLSearchParams(location.search).get("challenge");
  fill(
    byId("content"),
    h(
      "div",
      { class: "title" },
      challenge && h("p", { class: "crumbs quiet" }, h("a", { href: `/challenges/${encodeURIComponent(challenge)}` }, challenge), " / submit"),
      h("h1", {}, "Submit an agent"),
      h("p", { class: "lead quiet" }, "An agent is a name; each submission is a version of it that never changes."),
    ),
    h("div", { class: "panel" }, submission(mine, Object.keys(described.controls ?? {}), challenge)),
  );
});

function submission(mine, controls, challenge) {
  const kind = select([["onnx", "ONNX policy, run by the service"], ["remote", "remote: your own worker drives"], ["builtin", "built-in agent of this service"]]);
  const agent = select([[NEW, "a new agent"], ...mine.map((one) => [one.name, `${one.name} (v${one.version ?? 0})`])]);
  const named = field("Name", "name", input("text", { maxlength: 100, pattern: "[A-Za-z0-9][A-Za-z0-9._\\-]*" }), "Letters, digits, dots, hyphens and underscores. No other owner can use it afterwards.");
  const file = field("File", "file", input("file", { accept: ".onnx" }), "One .onnx file without external data. It is checked, tried for two decisions, and runs without network and files.");
  const entry = field("Built-in agent", "entry", input("text", { value: "autopilot" }), "A registered name, as `dohyo agents list` shows them.");
  const track = field("Track", "track", select([["map", "map"], ["sensors", "sensors"], ["privileged", "privileged"]]), "Limits the sensors that the agent may use.");
  const sensors = field("Sensors", "sensors", input("text", { value: SENSORS.map }), "Names with commas, in the order of the policy's inputs.");
  const names = controls.length ? controls : ["target_speed_steering", "acceleration_steering"];
  const control = field("Control", "control", select(names.map((one) => [one, one]), "target_speed_steering"), "What the agent's output means.");
  const done = h("div", { role: "status" });
  const only = () => {
    named.hidden = agent.value !== NEW;
    file.hidden = kind.value !== "onnx";
    entry.hidden = kind.value !== "builtin";
    for (const one of [track, sensors, control]) one.hidden = kind.value === "builtin";
  };
  kind.addEventListener("change", only);
  agent.addEventListener("change", only);
  only();
  const element = form(
    [field("Kind", "kind", kind), field("Agent", "agent", agent), named, file, entry, track, sensors, control],
    "submit",
    async (values) => {
      fill(done);
      const name = await agentOf(values, mine);
      const made = await send("POST", `/v1/agents/${encodeURIComponent(name)}/submissions${values.get("kind") === "onnx" ? "/onnx" : ""}`, orderOf(values));
      fill(done, success(name, made, challenge));
    },
    "file",
  );
  return [element, done];
}

/** The name of the chosen agent; a new one is registered first, once. */
async function agentOf(values, mine) {
  if (values.get("agent") !== NEW) return values.get("agent");
  const name = values.get("name");
  if (!mine.some((one) => one.name === name)) mine.push(await send("POST", "/v1/agents", { name }));
  return name;
}

function orderOf(values) {
  if (values.get("kind") === "builtin") return { kind: "builtin", entry: values.get("entry") };
  const sensors = values.get("sensors").split(",").map((one) => one.trim()).filter(Boolean);
  const spec = { track: values.get("track"), sensors, control: values.get("control") };
  if (values.get("kind") === "remote") return { kind: "remote", ...spec };
  const body = new FormData();
  body.append("spec", JSON.stringify(spec));
  body.append("file", values.get("file"));
  return body;
}

function success(name, made, challenge) {
  const next = challenge ? `/challenges/${encodeURIComponent(challenge)}` : `/agents/${encodeURIComponent(name)}`;
  return h(
    "p",
    { class: "submitted" },
    h("span", { class: "status success" }, h("i", { "aria-hidden": "true" }, "✓"), `${name} v${made.version} is submitted. `),
    h("a", { href: next }, challenge ? "start a run" : "its page"),
  );
}
