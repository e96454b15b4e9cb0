/** What to paste into a shell where a page has nothing to show yet. */

import { h } from "./dom.js";
import { copyText } from "./table.js";

/** Submits the built-in autopilot and evaluates it, by the REST interface alone. */
export function startCommand(benchmark) {
  const post = (path, body) =>
    `curl -s ${location.origin}/v1/${path} -H "Authorization: Bearer $TOKEN" --json '${JSON.stringify(body)}'`;
  const text = [
    post("agents", { name: "autopilot" }),
    post("agents/autopilot/submissions", { kind: "builtin", entry: "autopilot" }),
    post("evaluations", { agent: "autopilot", benchmark }),
  ].join(" &&\n");
  const button = h("button", { type: "button", class: "copy" }, "copy");
  button.addEventListener("click", async () => {
    await copyText(text);
    button.textContent = "copied";
  });
  return h("div", { class: "example" }, button, h("pre", { class: "command", tabindex: 0 }, h("code", {}, text)));
}
