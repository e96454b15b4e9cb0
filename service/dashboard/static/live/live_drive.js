/** A drive that grows: scenes of a live world are appended, and what is older than the trails is dropped. */

import { Drive } from "../replay/drive.js";
import { planOf } from "../replay/reasons.js";

const KEPT_TICKS = 40;
const STALE_TICKS = 5; // a plan older than half a second is not shown

export class LiveDrive extends Drive {
  /** @param stage what does not change in the world: bounds, egos with routes, stop lines */
  constructor(stage) {
    super({
      dt_s: stage.dt_s,
      ticks: 0,
      bounds: stage.bounds,
      actors: [],
      egos: stage.egos.map((ego) => ({ ...ego, infractions: [] })),
      signals: stage.signals.map(({ line }) => ({ line, changes: [[0, 0]] })),
    });
    this.tick = -1;
    this.egoTracks = this.egos.map((ego) => empty(ego.name, "ego", ego.length, ego.width));
    this.egos.forEach((ego, i) => (ego.track = this.egoTracks[i]));
    this.actors = new Map();
    this.plans = {}; // of each ego, the last one with its tick
  }

  /** Simulated time of the newest scene, s. */
  get newest() {
    return Math.max(0, this.tick) * this.dt;
  }

  /** Appends a scene; one of an earlier tick begins the drive again. */
  add(scene) {
    if (scene.tick < this.tick) this._forget();
    this.tick = scene.tick;
    scene.egos.forEach(([x, y, heading, speed, active], i) => {
      if (active) extend(this.egoTracks[i], scene.tick, [x, y, heading, speed]);
    });
    const present = new Map();
    for (const [key, kind, length, width, x, y, heading] of scene.actors) {
      const one = this.actors.get(key) ?? empty(String(key), kind, length, width);
      extend(one, scene.tick, [x, y, heading, 0]);
      present.set(key, one);
    }
    this.actors = present;
    this._arrange();
    this.signals.forEach((lamp, i) => (lamp.states[0] = Number(scene.lights[i])));
  }

  /** The plan that the driver of an ego has sent, in the network frame; null where there is none, or an old one. */
  planOf(ego) {
    const plan = this.plans[ego.name];
    const age = this.tick - (plan?.tick ?? -Infinity);
    return plan && age >= 0 && age <= STALE_TICKS ? planOf({ trajectory: plan.points }, ego.track, plan.tick) : null;
  }

  _forget() {
    this.actors.clear();
    for (const one of this.egoTracks) Object.assign(one, empty(one.name, "ego", one.length, one.width));
  }

  /** Lists the egos first, each in its place, and makes room for the poses of all. */
  _arrange() {
    this.tracks = [...this.egoTracks, ...this.actors.values()];
    this.count = this.tracks.length;
    if (this.count <= this.shown.length) return;
    const room = 2 * this.count;
    this.shown = new Uint8Array(room);
    for (const name of ["x", "y", "cos", "sin", "speed"]) this[name] = new Float64Array(room);
  }
}

const empty = (name, kind, length, width) => ({
  ...{ name, kind, length, width, first: 0, count: 0 },
  ...{ x: [], y: [], heading: [], speed: [] },
});

/** Appends a pose at a tick to a track; ticks between two scenes are interpolated. */
function extend(track, tick, [x, y, heading, speed]) {
  const last = track.first + track.count - 1;
  const gap = tick - last;
  if (!track.count || gap > KEPT_TICKS) {
    Object.assign(track, { first: tick, count: 1, x: [x], y: [y], heading: [heading], speed: [speed] });
    return;
  }
  const at = track.count - 1;
  const from = { x: track.x[at], y: track.y[at], heading: track.heading[at], speed: track.speed[at] };
  const turn = Math.atan2(Math.sin(heading - from.heading), Math.cos(heading - from.heading));
  for (let k = 1; k <= gap; k++) {
    const share = k / gap;
    track.x.push(from.x + share * (x - from.x));
    track.y.push(from.y + share * (y - from.y));
    track.heading.push(from.heading + share * turn);
    track.speed.push(from.speed + share * (speed - from.speed));
  }
  const old = Math.max(0, track.x.length - KEPT_TICKS);
  for (const name of ["x", "y", "heading", "speed"]) track[name].splice(0, old);
  track.first += old;
  track.count = track.x.length;
}
