/** The time that a live view shows: it follows the newest scene smoothly, a scene behind. */

const LONGEST_MS = 400;
const JUMP_S = 4; // further behind, or ahead, it jumps

export class LiveClock {
  /** @param {number} dt_s length of a tick */
  constructor(dt_s) {
    this.dt = dt_s;
    this.time = 0;
    this._from = 0;
    this._to = 0;
    this._begun = 0;
    this._span = 100;
    this._listeners = [];
    this._requested = false;
    this._still = matchMedia("(prefers-reduced-motion: reduce)");
    this._frame = this._frame.bind(this);
  }

  /** Calls `listener(time_s)` on every frame that is drawn. */
  onFrame(listener) {
    this._listeners.push(listener);
  }

  /** A scene of a time has come. */
  follow(time_s) {
    const now = performance.now();
    const jumps = this._still.matches || Math.abs(time_s - this.time) > JUMP_S;
    this._span = Math.min(LONGEST_MS, Math.max(50, now - this._begun));
    this._from = jumps ? time_s : this.time;
    this._to = time_s;
    this._begun = now;
    this.request();
  }

  /** Requests one frame, also when it is called several times before that frame. */
  request() {
    if (this._requested) return;
    this._requested = true;
    requestAnimationFrame(this._frame);
  }

  _frame(now) {
    this._requested = false;
    const share = Math.min(1, Math.max(0, (now - this._begun) / this._span));
    this.time = this._from + share * (this._to - this._from);
    for (const listener of this._listeners) listener(this.time);
    if (share < 1) this.request();
  }
}
