/** One replay on one canvas: roads, route, trails, actors, lights and marks of infractions, seen by a camera. */

import { drawActors, drawInvolved, drawNames, drawSignals, drawTrails } from "./actors.js";
import { Camera, steer } from "./camera.js";
import { readColours } from "./colours.js";
import { drawPlan } from "./reasons.js";
import { LotScene } from "./lot_scene.js";
import { Scene, polyline } from "./scene.js";
import { words } from "../words.js";

const ROUTE_M = 2.4;
const CHOSEN_M = 1.7;
const MARK_PX = 1.5; // marks are drawn within -5..5
const PIN = 16; // from the place up to the mark, in the mark's units

export class View {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./drive.js").Drive} drive
   * @param map geometry of the roads, or `lot`: what stands in a parking lot
   * @param {import("./clock.js").Clock} clock
   * @param {AbortSignal} [signal] after which it watches nothing
   */
  constructor(canvas, drive, map, clock, signal) {
    this.canvas = canvas;
    this.drive = drive;
    this.clock = clock;
    this.camera = new Camera();
    this.scene = map.lot ? new LotScene(map.lot) : new Scene(map);
    this.context = canvas.getContext("2d", { alpha: false });
    this.dash = { solid: [], yellow: [0.6, 0.4] };
    this.plan = null; // the plan of the agent at this moment, if known
    this.onCamera = () => {};
    this.choose(drive.egos[0]);
    this.colours = readColours(canvas);
    this._watch(signal);
    clock.onFrame((time_s) => this.draw(time_s));
  }

  /** Follows an ego, and shows its route and infractions. */
  choose(ego) {
    this.ego = ego;
    this.egoIndex = this.drive.indexOf(ego);
    this.infractions = ego.infractions;
    this.route = new Path2D();
    polyline(this.route, ego.route, false);
    this.marks = ego.infractions.map((one) => new Path2D(words.marks[one.kind].path));
  }

  /** Box of the chosen ego's route, with some room; of the whole lot where there are no routes. */
  routeBounds() {
    if (!this.ego.route.length) return this.drive.bounds;
    const xs = this.ego.route.map((point) => point[0]);
    const ys = this.ego.route.map((point) => point[1]);
    return [Math.min(...xs) - 15, Math.min(...ys) - 15, Math.max(...xs) + 15, Math.max(...ys) + 15];
  }

  draw(time_s) {
    const { camera, context: c, drive, colours } = this;
    drive.place(time_s);
    if (camera.follow && this.egoIndex >= 0) {
      this._lookAtEgo(time_s);
    }
    c.setTransform(1, 0, 0, 1, 0, 0);
    this.scene.draw(c, camera, colours);
    camera.apply(c);
    const px = 1 / camera.scale;
    this._drawRoute(px);
    drawTrails(c, drive, time_s, colours, px);
    drawSignals(c, drive, colours, px, this.dash);
    if (this.plan) drawPlan(c, this.plan, colours, px);
    drawActors(c, drive, colours, px);
    if (!this.ego.route.length && drive.egos.length > 1) this._drawChosen(px);
    drawInvolved(c, drive, this.infractions, time_s, colours, px);
    this._drawMarks(time_s);
    if (this.ego.route.length && drive.egos.length > 1) drawNames(c, drive, camera, colours);
  }

  /** The camera follows the ego; after its last tick it stays there. Of an ego that was never seen it shows the route's start. */
  _lookAtEgo(time_s) {
    const track = this.ego.track;
    if (!track.count) {
      if (this.ego.route.length) this.camera.lookAt(...this.ego.route[0]);
      return;
    }
    if (this.drive.shown[this.egoIndex]) {
      this.camera.lookAt(this.drive.x[this.egoIndex], this.drive.y[this.egoIndex]);
    } else {
      const k = time_s / this.drive.dt < track.first ? 0 : track.count - 1;
      this.camera.lookAt(track.x[k], track.y[k]);
    }
  }

  _drawRoute(px) {
    const c = this.context;
    if (!this.ego.route.length) return;
    c.globalAlpha = 0.22;
    c.strokeStyle = this.colours.accent;
    c.lineWidth = Math.max(ROUTE_M, 3 * px);
    c.lineCap = "round";
    c.lineJoin = "round";
    c.stroke(this.route);
    c.globalAlpha = 1;
    const goal = this.ego.route[this.ego.route.length - 1];
    c.lineWidth = 2 * px;
    c.fillStyle = this.colours.page;
    c.beginPath();
    c.arc(goal[0], goal[1], Math.max(1.1, 5 * px), 0, 2 * Math.PI);
    c.fill();
    c.stroke();
  }

  /** A ring around the chosen one of several karts, which have no routes to tell them by. */
  _drawChosen(px) {
    const c = this.context;
    c.strokeStyle = this.colours.accent;
    c.lineWidth = 2 * px;
    c.beginPath();
    c.arc(this.drive.x[this.egoIndex], this.drive.y[this.egoIndex], CHOSEN_M, 0, 2 * Math.PI);
    c.stroke();
  }

  /** Pins above the places of infractions; pins of later infractions are faint. */
  _drawMarks(time_s) {
    const { camera, context: c, colours, infractions } = this;
    const size = MARK_PX * camera.ratio;
    for (let i = 0; i < infractions.length; i++) {
      const one = infractions[i];
      const x = camera.left() + one.x_m * camera.scale * camera.ratio;
      const y = camera.top() - one.y_m * camera.scale * camera.ratio;
      c.setTransform(size, 0, 0, size, x, y);
      c.globalAlpha = time_s + 1e-6 < one.time_s ? 0.4 : 1;
      c.strokeStyle = colours.infraction;
      c.lineWidth = 0.9;
      c.beginPath();
      c.moveTo(0, 0);
      c.lineTo(0, -PIN);
      c.stroke();
      c.setTransform(size, 0, 0, size, x, y - PIN * size);
      c.lineWidth = 2.4;
      c.strokeStyle = colours.page;
      c.stroke(this.marks[i]);
      c.fillStyle = one.at_fault === false ? colours.page : colours.infraction;
      c.fill(this.marks[i]);
      c.lineWidth = 1;
      c.strokeStyle = colours.infraction;
      c.stroke(this.marks[i]);
    }
    c.globalAlpha = 1;
  }

  _watch(signal) {
    const sizes = new ResizeObserver(() => this._resize());
    sizes.observe(this.canvas);
    signal?.addEventListener("abort", () => sizes.disconnect());
    const recolour = () => {
      this.colours = readColours(this.canvas);
      this.scene.forget();
      this.clock.request();
    };
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour, { signal });
    steer(this.canvas, this.camera, () => {
      this.onCamera();
      this.clock.request();
    });
    this._resize();
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = Math.min(2, devicePixelRatio || 1);
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.camera.resize(width, height, ratio);
    this.clock.request();
  }
}
