/** Commands for a shell, shown where a page is still empty. */

import { h } from "./dom.js";
import { copyText } from "./table.js";

/** The built-in agent that an empty page proposes for a benchmark of a kind. */
export const firstAgent = (kind) => ({ parking: "parking", forecasting: "forecaster" })[kind] ?? "autopilot";

/** Commands that submit a built-in agent and evaluate it, with curl alone. */
export function startCommand(benchmark, kind = "driving") {
  const agent = firstAgent(kind);
  const post = (path, body) =>
    `curl -s ${location.origin}/v1/${path} -H "Authorization: Bearer $TOKEN" -H "Prefer: wait=30" --json '${JSON.stringify(body)}'`;
  const text = [
    post("agents", { name: agent }),
    post(`agents/${agent}/submissions`, { kind: "builtin", entry: agent }),
    post("evaluations", { agent, benchmark, ranked: true }),
  ].join(" &&\n");
  const button = h("button", { type: "button", class: "copy" }, "copy");
  button.addEventListener("click", async () => {
    await copyText(text);
    button.textContent = "copied";
  });
  return h("div", { class: "example" }, button, h("pre", { class: "command", tabindex: 0 }, h("code", {}, text)));
}
