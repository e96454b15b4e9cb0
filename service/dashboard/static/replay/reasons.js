/** The agent's explanation of the moment shown: its plan and search on the road, its numbers beside. */

import { get } from "../api.js";
import { fill, h } from "../dom.js";
import { number } from "../format.js";

const PAUSE_MS = 300; // between two requests while the replay plays
const STALE_TICKS = 5; // a plan older than half a second is not shown
const TARGETS = ["target_speed", "target_speed_mps", "speed_limit"];
const SHOWN = 24; // largest number of values beside the road; the JSON has all
const DRAWN = new Set(["trajectory", "nodes", "plan", "frame", "agent"]);

export class Reasons {
  /** @param {string} episode @param player what `play` returned @param {HTMLElement} place for the numbers */
  constructor(episode, player, place) {
    this.path = `/v1/episodes/${encodeURIComponent(episode)}/explanation?tick=`;
    this.player = player;
    this.view = player.views[0];
    this.place = place;
    this.known = new Map();
    this.tick = -1;
    this.busy = false;
    this.begun = false;
    this.failed = false; // after a failure it waits for the next jump, start or stop
    player.clock.onChange(() => (this.failed = false));
    player.clock.onFrame((time_s) => this.begun && this._follow(time_s));
    fill(place, this._invitation());
  }

  /** Shows a button first, since the episode must be driven again for its explanations. */
  _invitation() {
    return [
      h("p", {}, h("button", { type: "button", click: () => this._begin() }, "show the agent's reasons")),
      h("p", { class: "quiet small" }, "The first time, the service drives the episode again, which takes as long as the episode did."),
    ];
  }

  async _begin() {
    const began = performance.now();
    const wait = () =>
      fill(
        this.place,
        h("p", { role: "status" }, `Driving the episode again: ${number((performance.now() - began) / 1000)} s so far`),
      );
    wait();
    const timer = setInterval(wait, 1000);
    try {
      await this._ask(this._now());
    } catch (error) {
      fill(this.place, h("p", { class: "reason" }, error.message));
      return;
    } finally {
      clearInterval(timer);
    }
    this.begun = true;
    this._follow(this.player.clock.time);
  }

  _now(time_s = this.player.clock.time) {
    return Math.floor(time_s / this.view.drive.dt + 1e-6);
  }

  async _ask(tick) {
    const answer = await get(this.path + tick);
    if (!answer.explanations) throw new Error("The episode is still being driven again; try again later.");
    this.known.set(tick, answer.explanations);
  }

  /** Shows the reasons of a moment when they arrive; sends at most one request per PAUSE_MS, and one at a time. */
  _follow(time_s) {
    const tick = this._now(time_s);
    if (Math.abs(tick - this.tick) > STALE_TICKS) [this.view.plan, this.tick] = [null, -1];
    if (this.known.has(tick)) {
      if (tick !== this.tick || this.ego !== this.view.ego.name) this._show(tick);
    } else if (!this.busy && !this.failed) {
      this.busy = true;
      const answered = this._ask(tick).then(
        () => this.player.clock.request(),
        (error) => {
          this.failed = true;
          fill(this.place, h("p", { class: "reason" }, error.message));
        },
      );
      const paused = new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
      Promise.all([answered, paused]).then(() => {
        this.busy = false;
        this.player.clock.request();
      });
    }
  }

  _show(tick) {
    this.tick = tick;
    this.ego = this.view.ego.name;
    const why = this.known.get(tick)[this.ego] ?? null;
    this.view.plan = why && planOf(why, this.view.ego.track, tick);
    this.player.clock.request();
    fill(
      this.place,
      why
        ? h(
            "div",
            { class: "why" },
            h(
              "dl",
              {},
              rows(why)
                .slice(0, SHOWN)
                .map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", { class: "number" }, text))),
            ),
          )
        : h("p", { class: "quiet" }, "The agent gave no reason for this moment."),
      this.view.plan?.explored.length > 0 &&
        h(
          "p",
          { class: "quiet small" },
          `thin lines: ${this.view.plan.explored.length} branches of the search; darker ones were visited more often`,
        ),
      h("p", { class: "links" }, h("a", { href: this.path + tick }, "this moment as JSON")),
    );
  }
}

/**
 * Lines in the network frame: `path`, the plan of the agent, and `explored`, the branches of its search, each with its
 * share of the visits in [0, 1]. An explanation's trajectories are in the ego's frame.
 */
export function planOf(why, track, tick) {
  const k = tick - (track?.first ?? 0);
  if (!track || k < 0 || k >= track.count) return null;
  const [cos, sin] = [Math.cos(track.heading[k]), Math.sin(track.heading[k])];
  const place = ([x, y]) => [track.x[k] + cos * x - sin * y, track.y[k] + sin * x + cos * y];
  const nodes = (why.nodes ?? []).filter((node) => node.trajectory?.length);
  const chosen = new Set(why.plan ?? []);
  const most = Math.max(1, ...nodes.map((node) => node.n));
  const path = nodes.filter((node) => chosen.has(node.node)).flatMap((node) => node.trajectory);
  const points = path.length ? path : (why.trajectory ?? []);
  return {
    path: points.map(place),
    explored: nodes.map((node) => ({ points: node.trajectory.map(place), share: node.n / most, failed: node.failed })),
  };
}

/** Names and numbers of an explanation, one level deep, the target speed first. */
function rows(why) {
  const found = [];
  for (const [name, value] of Object.entries(why)) {
    if (DRAWN.has(name)) continue;
    if (told(value) !== null) found.push([name, told(value)]);
    else if (value && typeof value === "object" && !Array.isArray(value))
      for (const [inner, one] of Object.entries(value))
        if (told(one) !== null) found.push([`${name} · ${inner}`, told(one)]);
  }
  const first = ([name]) => (TARGETS.includes(name) ? 0 : 1);
  return found.sort((a, b) => first(a) - first(b)).map(([name, text]) => [name.replaceAll("_", " "), text]);
}

function told(value) {
  if (typeof value === "number") return number(value);
  return typeof value === "string" || typeof value === "boolean" ? String(value) : null;
}

/** Draws a plan under the actors: branches thin, the plan bold. */
export function drawPlan(c, plan, colours, px) {
  c.lineCap = "round";
  c.lineJoin = "round";
  for (const one of plan.explored) {
    c.globalAlpha = 0.15 + 0.6 * Math.sqrt(one.share);
    c.strokeStyle = one.failed ? colours.infraction : colours.ink;
    c.lineWidth = Math.max(0.06, 1.2 * px);
    stroke(c, one.points);
  }
  c.globalAlpha = 1;
  c.strokeStyle = colours.accent;
  c.lineWidth = Math.max(0.35, 3 * px);
  stroke(c, plan.path);
}

function stroke(c, points) {
  c.beginPath();
  for (let i = 0; i < points.length; i++) {
    if (i) c.lineTo(points[i][0], points[i][1]);
    else c.moveTo(points[i][0], points[i][1]);
  }
  c.stroke();
}
