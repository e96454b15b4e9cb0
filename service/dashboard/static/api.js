/** The service's REST interface as pages read it. The browser's session cookie comes along by itself. */

import { byId, fill, h } from "./dom.js";

/** What the service answered instead of data. */
export class ApiError extends Error {
  constructor(status, title, detail) {
    super(detail || title);
    this.status = status;
    this.title = title;
  }
}

/** Reads JSON; 202 with Retry-After is waited for. */
export async function get(path) {
  for (let attempt = 0; ; attempt++) {
    const answer = await fetch(path, { headers: { accept: "application/json" } });
    if (answer.status === 202 && attempt < 60) {
      await new Promise((done) => setTimeout(done, 1000 * Number(answer.headers.get("retry-after") ?? 1)));
      continue;
    }
    if (!answer.ok) throw await problem(answer);
    return answer.json();
  }
}

/** Reads all items of a list that comes in pages, up to `most`. */
export async function getAll(path, most = 10_000) {
  const items = [];
  let after = null;
  do {
    const url = new URL(path, location.origin);
    url.searchParams.set("limit", url.searchParams.get("limit") ?? "200");
    if (after) url.searchParams.set("after", after);
    const page = await get(url.pathname + url.search);
    if (Array.isArray(page)) return page;
    items.push(...page.items);
    after = page.next;
  } while (after && items.length < most);
  return items;
}

async function problem(answer) {
  const body = await answer.json().catch(() => ({}));
  const detail = typeof body.detail === "string" ? body.detail : "";
  return new ApiError(answer.status, body.title ?? answer.statusText, detail);
}

/** Listens to server-sent events of some names; the browser connects again by itself. Returns what ends it. */
export function listen(path, names, listener) {
  const source = new EventSource(path);
  for (const name of names) {
    source.addEventListener(name, (event) => listener(JSON.parse(event.data), name));
  }
  return () => source.close();
}

/** Runs what fills a page; where that fails, the page says what came instead, and what to do. */
export async function page(run) {
  try {
    await run();
  } catch (error) {
    console.warn(error);
    fill(byId("content"), failure(error));
    byId("content").dataset.state = "failed";
    return;
  }
  byId("content").dataset.state = "ready";
}

function failure(error) {
  const status = error instanceof ApiError ? error.status : 0;
  const back = encodeURIComponent(location.pathname + location.search);
  const says = {
    0: ["This page could not be built", "The service did not answer, or answered something unexpected."],
    401:
      document.body.dataset.signedIn === "yes"
        ? ["Your token is no longer accepted", "Sign out, or sign in with another one."]
        : ["This needs a token", "The service is private."],
    403: ["This needs another token", "Yours may not see it."],
    404: ["Nothing here", "It does not exist, or is somebody else's and private."],
    429: ["Too many requests", "Wait a moment and load the page again."],
  }[status] ?? [`The service answered ${status}`, ""];
  return h(
    "section",
    { class: "state", role: "alert" },
    h("h2", {}, says[0]),
    h("p", {}, says[1]),
    error.message && h("p", { class: "quiet" }, error.message),
    status === 401 || status === 403
      ? h("p", {}, h("a", { class: "button", href: `/login?next=${back}` }, "sign in with a token"))
      : h("p", {}, h("a", { class: "button", href: location.href }, "load again")),
  );
}
