/** Code of every page: shows the owner of the token, and lets examples be copied. */

import { get } from "./api.js";
import { byId, h } from "./dom.js";
import { copyText } from "./table.js";

if (document.body.dataset.signedIn === "yes") {
  get("/v1/me").then(
    (me) => (byId("me").textContent = `${me.owner} (${me.role})`),
    (error) =>
      error.status === 401 &&
      byId("who").prepend(h("span", { class: "problem", role: "alert" }, "your token is no longer accepted")),
  );
}

for (const button of document.querySelectorAll("[data-copy]")) {
  button.addEventListener("click", async () => {
    await copyText(button.parentElement.querySelector("code").textContent);
    button.textContent = "copied";
    setTimeout(() => (button.textContent = "copy"), 1500);
  });
}
