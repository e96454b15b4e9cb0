/** Commands for a shell that evaluate a first agent, shown where a page is still empty. */

import { command } from "./command.js";

/** Built-in agents by family; the plans of a freeway have none, since there a worker of the reader's own plans. */
const BUILTIN = { driving: "autopilot", parking: "parking", forecasting: "forecaster" };
const PLANNER = { kind: "remote", track: "privileged", sensors: ["speeds"], control: "target_speeds" };

/** What these commands do, for a benchmark of a family; `amount` is what a run consists of, such as "18 drives". */
export const startText = (family, amount) =>
  family === "freeway"
    ? `These commands submit a planner, order its evaluation in ${amount}, and start its worker, an example in dohyo's sources:`
    : `These commands submit the built-in agent ${BUILTIN[family]} and evaluate it in ${amount}:`;

/** Commands that submit an agent and evaluate it: with curl alone, but for the worker of a freeway's planner. */
export function startCommand(benchmark, family = "driving") {
  const planned = family === "freeway";
  const agent = planned ? "my-planner" : BUILTIN[family];
  const post = (path, body) =>
    `curl -s ${location.origin}/v1/${path} -H "Authorization: Bearer $TOKEN" -H "Prefer: wait=30" --json '${JSON.stringify(body)}'`;
  const commands = [
    post("agents", { name: agent }),
    post(`agents/${agent}/submissions`, planned ? PLANNER : { kind: "builtin", entry: agent }),
    post("evaluations", { agent, benchmark, ranked: true }),
    planned && `python examples/planner.py ${location.origin} "$TOKEN" ${agent}`,
  ];
  return command(commands.filter(Boolean).join(" &&\n"));
}
