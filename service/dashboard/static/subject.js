/** The subject of a page, and the colours of the agents on it. */

import { get } from "./api.js";

/** The name or id in the address of the page, which the server wrote into the page. */
export const subject = () => JSON.parse(document.getElementById("subject").textContent);

/** A colour per agent, computed from its name and so the same on every page; none if the request fails. */
export async function colours(agents) {
  const names = [...new Set(agents)].sort();
  return get(`/colours?agent=${encodeURIComponent(JSON.stringify(names))}`).catch(() => ({}));
}
