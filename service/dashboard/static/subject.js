/** What a page is about, and the colours of the agents on it. */

import { get } from "./api.js";

/** The name or id in the page's address, as the server put it there. */
export const subject = () => JSON.parse(document.getElementById("subject").textContent);

/** A colour per agent that follows from its name, the same on every page; without one, pages still work. */
export async function colours(agents) {
  const names = [...new Set(agents)].sort();
  return get(`/colours?agent=${encodeURIComponent(JSON.stringify(names))}`).catch(() => ({}));
}
