/** Client of the service's REST interface. The browser sends the session cookie by itself. */

import { byId, fill, h } from "./dom.js";

/** An error answer of the service; `faults` name the places in the request and what is expected there. */
export class ApiError extends Error {
  constructor(status, title, detail, faults = []) {
    super(detail || title);
    this.status = status;
    this.title = title;
    this.faults = faults;
  }
}

const MARK = { "x-dohyo-page": "1" }; // the session cookie changes things only with it: see session.py
const LONGEST_JOB_S = 300;
const FIRST_WAIT_S = 2;
const LONGEST_WAIT_S = 30;

/**
 * Sends a change: a form as multipart, anything else as JSON. What the service does as a job is awaited.
 * @returns the answer's document, or null
 */
export async function send(method, path, body) {
  const multipart = body instanceof FormData;
  const headers = { accept: "application/json", prefer: "wait=20", ...MARK };
  if (body !== undefined && !multipart) headers["content-type"] = "application/json";
  const answer = await fetch(path, { method, headers, body: multipart || body === undefined ? body : JSON.stringify(body) });
  if (!answer.ok) throw await problem(answer);
  if (answer.status === 204) return null;
  const document = await answer.json();
  return answer.status === 202 ? finished(document) : document;
}

/** Follows a job to its end; returns what it made, or throws its failure. */
async function finished(job) {
  for (let left = LONGEST_JOB_S; left > 0 && ["queued", "running"].includes(job.status); left--) {
    await new Promise((done) => setTimeout(done, 1000));
    job = await get(`/v1/jobs/${encodeURIComponent(job.id)}`);
  }
  if (job.status === "done") return job.answer;
  const { status = 500, title = `The job is ${job.status}`, detail = "", errors = [] } = job.failure ?? {};
  throw new ApiError(status, title, detail, errors);
}

/** Reads JSON; repeats the request after an answer 202, as its header Retry-After says. */
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

const cut = new Map(); // how many items were read of lists that have more, by what they are

/** Reads the items of a list, page by page, up to `most`; the page tells where there are more. */
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
  if (after || items.length > most) cut.set(path.split("?")[0].split("/").pop(), most);
  return items.slice(0, most);
}

async function problem(answer) {
  const body = await answer.json().catch(() => ({}));
  const detail = typeof body.detail === "string" ? body.detail : "";
  return new ApiError(answer.status, body.title ?? answer.statusText, detail, body.errors ?? []);
}

/**
 * Listens to server-sent events of some names. The browser reconnects by itself after a break, but never after a refusal,
 * such as that of a proxy while the service restarts: then the state is read, and the events are requested again later.
 * @param {{hear: (data: any, name: string) => void, reread: () => Promise<boolean>, notice: {tell: (error?: Error) => void,
 *   clear: () => void}}} page is told each event; `reread` reads and shows the state, and says whether there is still
 *   something to listen to; `notice` stands from a break until the events come again
 * @returns {() => void} stops it
 */
export function listen(path, names, { hear, reread, notice }) {
  let source = null;
  let timer = 0;
  let wait_s = FIRST_WAIT_S;
  let stopped = false;
  const heard = (event) => {
    wait_s = FIRST_WAIT_S;
    hear(JSON.parse(event.data), event.type);
  };
  const open = () => {
    source = new EventSource(path);
    for (const name of names) source.addEventListener(name, heard);
    source.addEventListener("open", notice.clear);
    source.addEventListener("error", broken);
  };
  const again = async () => {
    const goesOn = await reread().catch((error) => {
      console.info(error);
      notice.tell(error);
      return true;
    });
    if (!goesOn) notice.clear();
    else if (!stopped) open();
  };
  function broken() {
    if (stopped) return;
    notice.tell();
    if (source.readyState !== EventSource.CLOSED) return;
    timer = setTimeout(again, 1000 * wait_s);
    wait_s = Math.min(LONGEST_WAIT_S, 2 * wait_s);
  }
  open();
  return () => {
    stopped = true;
    clearTimeout(timer);
    source.close();
  };
}

/** Runs the function that fills a page; if it fails, the page shows the error and what the user can do. */
export async function page(run) {
  try {
    await run();
  } catch (error) {
    if (error instanceof ApiError) console.info(error.message);
    else console.warn(error);
    fill(byId("content"), failure(error));
    byId("content").dataset.state = "failed";
    return;
  }
  byId("content").append(...[...cut].map(ofMore));
  byId("content").dataset.state = "ready";
}

/** Says that a list was read in part. */
const ofMore = ([what, most]) =>
  h("p", { class: "note" }, `This page reads the first ${most.toLocaleString("en")} ${what} only; the `, h("a", { href: "/api" }, "API"), " has all.");

function failure(error) {
  const status = error instanceof ApiError ? error.status : 0;
  const back = encodeURIComponent(location.pathname + location.search);
  const says = {
    0: ["This page could not be loaded", "The service did not answer, or its answer was not as expected."],
    401:
      document.body.dataset.signedIn === "yes"
        ? ["Your token is no longer accepted", "Sign out, or sign in with another one."]
        : ["A token is needed", "The service is private."],
    403: ["Not allowed", "Your token may not read this."],
    404: ["Not found", "It does not exist, or is private and belongs to another owner."],
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
