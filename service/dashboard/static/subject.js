/** The subject of a page, and the colours of the agents on it. */

import { get } from "./api.js";

/** The name or id in the address of the page, which the server wrote into the page. */
export const subject = () => JSON.parse(document.getElementById("subject").textContent);

const AT_ONCE = 100; // names that an address has room for

/** A colour per agent, computed from its name and so the same on every page; none if the request fails. */
export async function colours(agents) {
  const names = [...new Set(agents)].sort();
  const parts = [];
  while (names.length) parts.push(names.splice(0, AT_ONCE));
  const found = parts.map((part) => get(`/colours?agent=${encodeURIComponent(JSON.stringify(part))}`).catch(() => ({})));
  return Object.assign({}, ...(await Promise.all(found)));
}
