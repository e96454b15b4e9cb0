/** Commands for a shell, shown where a page is still empty. */

import { h } from "./dom.js";
import { copyText } from "./table.js";

/** Commands that submit the built-in autopilot and evaluate it, with curl alone. */
export function startCommand(benchmark) {
  const post = (path, body) =>
    `curl -s ${location.origin}/v1/${path} -H "Authorization: Bearer $TOKEN" -H "Prefer: wait=30" --json '${JSON.stringify(body)}'`;
  const text = [
    post("agents", { name: "autopilot" }),
    post("agents/autopilot/submissions", { kind: "builtin", entry: "autopilot" }),
    post("evaluations", { agent: "autopilot", benchmark, ranked: true }),
  ].join(" &&\n");
  const button = h("button", { type: "button", class: "copy" }, "copy");
  button.addEventListener("click", async () => {
    await copyText(text);
    button.textContent = "copied";
  });
  return h("div", { class: "example" }, button, h("pre", { class: "command", tabindex: 0 }, h("code", {}, text)));
}
