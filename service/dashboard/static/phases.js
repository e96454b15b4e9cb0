/** Phases of a challenge: their state, the time left, and how runs count in them. */

import { h } from "./dom.js";
import { moment, number } from "./format.js";

const SIGNS = { planned: "·", open: "▸", closed: "!", final: "✓" };
const KINDS = { planned: "waiting", open: "running", closed: "warning", final: "success" };

/** The state of a phase, with its sign. */
export const stateOf = (phase) =>
  h("span", { class: `status ${KINDS[phase.state]}` }, h("i", { "aria-hidden": "true" }, SIGNS[phase.state]), phase.state);

/** The moment that a phase waits for next, as [name, time]; null once it is final. */
export function nextMoment(phase) {
  const [name, at] = { planned: ["opens", phase.opens], open: ["closes", phase.closes], closed: ["ends", phase.ends] }[phase.state] ?? [];
  return at ? [name, at] : null;
}

const SETTLES_MS = 500;
const PATIENCE_MS = 10_000;

/**
 * Counts down to a time, each second; `reached` is called once when it has come. It is called late where the time was
 * past from the beginning: then the reader's clock is fast, and the service may still be before that time.
 */
export function countdown(iso, reached = () => {}) {
  const element = h("span", { class: "number countdown" });
  const at = new Date(iso).getTime();
  const late = at <= Date.now();
  const tick = () => {
    const left = at - Date.now();
    element.textContent = left > 0 ? remaining(left / 1000) : "now";
    if (left <= 0) {
      clearInterval(timer);
      setTimeout(reached, late ? PATIENCE_MS : SETTLES_MS);
    }
  };
  const timer = setInterval(tick, 1000);
  tick();
  return element;
}

function remaining(seconds) {
  const s = Math.ceil(seconds);
  const two = (n) => String(n).padStart(2, "0");
  const clock = `${two(Math.floor((s % 86_400) / 3600))}:${two(Math.floor((s % 3600) / 60))}:${two(s % 60)}`;
  return s >= 86_400 ? `${Math.floor(s / 86_400)} d ${clock}` : clock;
}

/** A period in words, such as `24 h`. */
export const period = (s) => (s >= 3600 ? `${Number((s / 3600).toPrecision(3))} h` : `${Number((s / 60).toPrecision(3))} min`);

const MOST_LISTED = 20;

/** Seeds, of many only the first and the last. */
export const listed = (seeds) => (seeds.length > MOST_LISTED ? `${seeds.length}, ${seeds[0]} to ${seeds.at(-1)}` : seeds.join(", "));

/** The conditions of a phase as facts. */
export function conditions(phase) {
  return [
    ["benchmark", h("a", { href: `/?benchmark=${encodeURIComponent(phase.benchmark)}` }, phase.benchmark)],
    ["seeds", phase.seeds ? listed(phase.seeds) : `${phase.seed_count}, secret until ${moment(phase.ends)}`],
    ["ranked runs", `${phase.runs_per_period} per ${period(phase.period_s)} and team`],
    ["place", phase.counts === "best" ? "the best complete run" : "the run ordered first, once complete"],
    ["opens", moment(phase.opens)],
    ["closes", moment(phase.closes)],
    ["track", phase.track ?? "any"],
    ["agents", phase.verified_only ? "built-in and ONNX only" : "all kinds"],
    ["deadline", `${number(phase.act_deadline_s)} s per decision`],
    ["shown to", `board ${phase.board}, replays ${phase.replays}, records ${phase.records}`],
  ];
}

/** Ranked runs that a team has left in a phase now. The period ends now, and also cancelled runs count. */
export function runsLeft(phase, runs, members) {
  const since = Date.now() - 1000 * phase.period_s;
  const used = runs.filter(
    (run) => run.ranking === phase.id && members.includes(run.owner) && new Date(run.created).getTime() > since,
  );
  return Math.max(0, phase.runs_per_period - used.length);
}
