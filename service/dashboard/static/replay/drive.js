/** The JSON of a replay as flat arrays, so that drawing a frame allocates no memory. */

/**
 * One gap-free appearance of an actor or an ego.
 * @typedef {{name: string, kind: string, length: number, width: number, first: number, count: number,
 *   x: Float32Array, y: Float32Array, heading: Float32Array, speed: Float32Array}} Track
 */

/** What the whole of a drive and its marks are called: on roads, and in a parking lot. */
const ON_ROADS = { whole: "route", mark: "infraction" };
const IN_A_LOT = { whole: "lot", mark: "contact" };

export class Drive {
  constructor(replay) {
    this.names = replay.lot ? IN_A_LOT : ON_ROADS;
    this.dt = replay.dt_s;
    this.ticks = replay.ticks;
    this.duration = Math.max(0, replay.ticks - 1) * replay.dt_s;
    this.bounds = replay.bounds;
    /** @type {Track[]} */
    this.tracks = replay.actors.map(track);
    this.egos = replay.egos.map((ego) => ({
      ...ego,
      track: this.tracks.find((one) => one.kind === "ego" && one.name === ego.name) ?? null,
    }));
    this.signals = lamps(replay.signals ?? []);
    this.count = this.tracks.length;
    // Poses of this frame, by track; `shown` is 0 for a track that is not in the world.
    this.shown = new Uint8Array(this.count);
    this.x = new Float64Array(this.count);
    this.y = new Float64Array(this.count);
    this.cos = new Float64Array(this.count);
    this.sin = new Float64Array(this.count);
    this.speed = new Float64Array(this.count);
  }

  /** Interpolates every pose at a time, and sets the lights. */
  place(time_s) {
    const at = time_s / this.dt;
    for (let i = 0; i < this.count; i++) {
      const one = this.tracks[i];
      const position = at - one.first;
      if (position < 0 || position > one.count - 1 + 1e-6) {
        this.shown[i] = 0;
        continue;
      }
      const k = Math.min(one.count - 1, Math.floor(position));
      const next = Math.min(one.count - 1, k + 1);
      const share = position - k;
      let turn = one.heading[next] - one.heading[k];
      if (turn > Math.PI) turn -= 2 * Math.PI;
      else if (turn < -Math.PI) turn += 2 * Math.PI;
      const heading = one.heading[k] + share * turn;
      this.shown[i] = 1;
      this.x[i] = one.x[k] + share * (one.x[next] - one.x[k]);
      this.y[i] = one.y[k] + share * (one.y[next] - one.y[k]);
      this.speed[i] = one.speed[k] + share * (one.speed[next] - one.speed[k]);
      this.cos[i] = Math.cos(heading);
      this.sin[i] = Math.sin(heading);
    }
    const tick = Math.floor(at + 1e-6);
    for (let i = 0; i < this.signals.length; i++) switchTo(this.signals[i], tick);
  }

  /** Index of an ego's track; -1 if it has none. */
  indexOf(ego) {
    return this.tracks.indexOf(ego.track);
  }
}

function track(one) {
  return {
    name: one.name,
    kind: one.kind,
    length: one.length,
    width: one.width,
    first: one.first,
    count: one.x.length,
    x: Float32Array.from(one.x),
    y: Float32Array.from(one.y),
    heading: Float32Array.from(one.heading),
    speed: Float32Array.from(one.speed),
  };
}

/** Signals that share a stop line get one slice of it each, in their order. */
function lamps(signals) {
  const sharing = new Map();
  for (const one of signals) {
    const key = one.line.join(" ");
    sharing.set(key, [...(sharing.get(key) ?? []), one]);
  }
  return [...sharing.values()].flatMap((group) =>
    group.map((one, place) => {
      const [x1, y1, x2, y2] = one.line;
      const at = (share) => [x1 + share * (x2 - x1), y1 + share * (y2 - y1)];
      return {
        line: Float32Array.of(...at(place / group.length), ...at((place + 1) / group.length)),
        tick: Int32Array.from(one.changes, (change) => change[0]),
        states: Uint8Array.from(one.changes, (change) => change[1]),
        next: 0,
        state: 0,
      };
    }),
  );
}

/** Sets a lamp to its state at a tick; fast if the time changes little between calls. */
function switchTo(lamp, tick) {
  while (lamp.next > 0 && lamp.tick[lamp.next - 1] > tick) lamp.next--;
  while (lamp.next < lamp.tick.length && lamp.tick[lamp.next] <= tick) lamp.next++;
  lamp.state = lamp.next > 0 ? lamp.states[lamp.next - 1] : 0;
}
