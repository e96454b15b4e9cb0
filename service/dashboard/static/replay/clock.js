/** Simulated time that plays, pauses and jumps. All views of the page listen to one clock. */

export const RATES = [0.25, 0.5, 1, 2, 4, 8];
const LONGEST_FRAME_S = 0.1; // after a pause of the browser tab the time must not jump ahead

export class Clock {
  /** @param {number} duration_s @param {number} dt_s length of a tick */
  constructor(duration_s, dt_s) {
    this.duration = duration_s;
    this.dt = dt_s;
    this.time = 0;
    this.rate = 1;
    this.playing = false;
    this._listeners = [];
    this._changes = [];
    this._requested = false;
    this._before = 0;
    this._frame = this._frame.bind(this);
  }

  /** Calls `listener(time_s)` on every frame that is drawn. */
  onFrame(listener) {
    this._listeners.push(listener);
  }

  /** Calls `listener()` after a jump, a start, a stop and a change of speed. */
  onChange(listener) {
    this._changes.push(listener);
  }

  seek(time_s) {
    this.time = Math.min(this.duration, Math.max(0, time_s));
    this._changed();
  }

  /** Moves by some ticks, negative ones backwards, and stops. */
  step(ticks) {
    this.playing = false;
    this.seek((Math.round(this.time / this.dt) + ticks) * this.dt);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.time >= this.duration) this.time = 0;
    this.playing = true;
    this._before = performance.now();
    this._changed();
  }

  pause() {
    this.playing = false;
    this._changed();
  }

  /** Stops without telling anybody. */
  stop() {
    this.playing = false;
  }

  setRate(rate) {
    this.rate = rate;
    this._changed();
  }

  /** Requests one frame, also when it is called several times before that frame. */
  request() {
    if (this._requested) return;
    this._requested = true;
    requestAnimationFrame(this._frame);
  }

  _changed() {
    for (const listener of this._changes) listener();
    this.request();
  }

  _frame(now) {
    this._requested = false;
    if (this.playing) this._advance(now);
    for (let i = 0; i < this._listeners.length; i++) this._listeners[i](this.time);
    if (this.playing) this.request();
  }

  _advance(now) {
    const elapsed_s = Math.min(Math.max(0, now - this._before) / 1000, LONGEST_FRAME_S);
    this._before = now;
    this.time += elapsed_s * this.rate;
    if (this.time < this.duration) return;
    this.time = this.duration;
    this.pause();
  }
}
