/** A command for a shell, with a button that copies it. */

import { h } from "./dom.js";
import { copyText } from "./table.js";

/** @param {string} text what the shell is given; it may have several lines */
export function command(text) {
  const button = h("button", { type: "button", class: "copy" }, "copy");
  button.addEventListener("click", async () => {
    await copyText(text);
    button.textContent = "copied";
    setTimeout(() => (button.textContent = "copy"), 1500);
  });
  return h("div", { class: "example" }, button, h("pre", { class: "command", tabindex: 0 }, h("code", {}, text)));
}
