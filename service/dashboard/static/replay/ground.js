/** A map of roads with marks; marks of one kind that would overlap become one mark with a number. */

import { Camera, steer } from "./camera.js";
import { Scene } from "./scene.js";
import { readColours } from "./colours.js";
import { words } from "../words.js";

const CROWD_PX = 22;
const REACH_PX = 14;
const SIZE = 1.2;
const CLOSEST = 40; // px per m; at this zoom, a crowd opens the replay of its first infraction
const DRAG_PX = 5;

/** The place nearest to the mean of all: the mean itself may lie beside the road. */
function central(places) {
  const mean = (axis) => places.reduce((sum, place) => sum + place[axis], 0) / places.length;
  const [mx, my] = [mean(0), mean(1)];
  const far = ([x, y]) => Math.hypot(x - mx, y - my);
  const [x, y] = places.reduce((best, place) => (far(place) < far(best) ? place : best));
  return { x, y };
}

export class GroundMap {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param map geometry of the roads
   * @param {number[]} box the part shown first: x0, y0, x1, y1, m
   * @param {{tip: HTMLElement, describe: (cluster: any) => string, open: (infraction: any) => void}} does
   * @param {AbortSignal} signal after which it watches nothing
   */
  constructor(canvas, map, box, does, signal) {
    Object.assign(this, { canvas, does, box, fitted: false });
    this.context = canvas.getContext("2d", { alpha: false });
    this.camera = new Camera();
    this.camera.follow = false;
    this.scene = new Scene(map);
    this.colours = readColours(canvas);
    this.paths = Object.fromEntries(Object.entries(words.marks).map(([kind, one]) => [kind, new Path2D(one.path)]));
    this.infractions = [];
    this.clusters = [];
    canvas.classList.add("free");
    new ResizeObserver(() => this._resize()).observe(canvas);
    const recolour = () => {
      this.colours = readColours(canvas);
      this.scene.forget();
      this.draw();
    };
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour, { signal });
    steer(canvas, this.camera, () => this.draw());
    this._listen();
    this._resize();
  }

  show(infractions) {
    this.infractions = infractions;
    this.draw();
  }

  fit(box) {
    this.camera.fit(box);
    this.draw();
  }

  zoom(factor) {
    this.camera.zoom(factor);
    this.draw();
  }

  draw() {
    if (this._waiting) return;
    this._waiting = true;
    requestAnimationFrame(() => {
      this._waiting = false;
      this._paint();
    });
  }

  _paint() {
    const { camera, context: c, colours } = this;
    c.setTransform(1, 0, 0, 1, 0, 0);
    this.scene.draw(c, camera, colours);
    this.clusters = this._crowds();
    const size = SIZE * camera.ratio;
    for (const { x, y, kind, items } of this.clusters) {
      const grown = size * (items.length > 1 ? 1.25 : 1);
      c.setTransform(grown, 0, 0, grown, x * camera.ratio, y * camera.ratio);
      c.lineWidth = 2.6;
      c.strokeStyle = colours.page;
      c.stroke(this.paths[kind]);
      c.fillStyle = items.every((one) => one.at_fault === false) ? colours.page : colours.infraction;
      c.fill(this.paths[kind]);
      c.lineWidth = 1;
      c.strokeStyle = colours.infraction;
      c.stroke(this.paths[kind]);
      if (items.length > 1) this._count(c, x, y, items.length);
    }
  }

  _count(c, x, y, n) {
    const { ratio } = this.camera;
    c.setTransform(ratio, 0, 0, ratio, x * ratio, y * ratio);
    c.font = '600 12px ui-monospace, "DejaVu Sans Mono", monospace';
    c.textBaseline = "middle";
    c.lineWidth = 4;
    c.lineJoin = "round";
    c.strokeStyle = this.colours.page;
    c.strokeText(String(n), 11, -8);
    c.fillStyle = this.colours.ink;
    c.fillText(String(n), 11, -8);
  }

  /** Groups of infractions of one kind whose marks would overlap; the mark is at the infraction nearest to their mean. */
  _crowds() {
    const { camera } = this;
    const found = new Map();
    for (const one of this.infractions) {
      const x = camera.left() / camera.ratio + one.x_m * camera.scale;
      const y = camera.top() / camera.ratio - one.y_m * camera.scale;
      const key = `${one.kind} ${Math.round((one.x_m * camera.scale) / CROWD_PX)} ${Math.round((one.y_m * camera.scale) / CROWD_PX)}`;
      const crowd = found.get(key) ?? { kind: one.kind, places: [], items: [] };
      crowd.items.push(one);
      crowd.places.push([x, y]);
      found.set(key, crowd);
    }
    return [...found.values()].map((crowd) => ({ ...crowd, ...central(crowd.places) }));
  }

  _at(event) {
    let best = null;
    let least = REACH_PX;
    for (const cluster of this.clusters) {
      const distance = Math.hypot(cluster.x - event.offsetX, cluster.y - event.offsetY);
      if (distance < least) [best, least] = [cluster, distance];
    }
    return best;
  }

  _listen() {
    const { canvas, does } = this;
    let pressed = [0, 0];
    canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
    canvas.addEventListener("click", (event) => {
      if (Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > DRAG_PX) return;
      const cluster = this._at(event);
      if (!cluster) return;
      if (cluster.items.length === 1 || this.camera.scale >= CLOSEST) does.open(cluster.items[0]);
      else this._approach(cluster);
    });
    canvas.addEventListener("pointermove", (event) => {
      const cluster = event.buttons ? null : this._at(event);
      does.tip.hidden = !cluster;
      canvas.classList.toggle("pointing", Boolean(cluster));
      if (!cluster) return;
      does.tip.textContent = does.describe(cluster);
      const left = Math.min(cluster.x + 12, canvas.clientWidth - does.tip.offsetWidth - 8);
      does.tip.style.setProperty("left", `${Math.max(8, left)}px`);
      does.tip.style.setProperty("top", `${cluster.y + 12}px`);
    });
    canvas.addEventListener("pointerleave", () => (does.tip.hidden = true));
    canvas.addEventListener("keydown", (event) => this._key(event));
  }

  _approach(cluster) {
    const xs = cluster.items.map((one) => one.x_m);
    const ys = cluster.items.map((one) => one.y_m);
    const scale = this.camera.scale;
    this.camera.fit([Math.min(...xs) - 4, Math.min(...ys) - 4, Math.max(...xs) + 4, Math.max(...ys) + 4]);
    this.camera.scale = Math.min(Math.max(this.camera.scale, scale * 1.5), CLOSEST, scale * 4);
    this.draw();
  }

  _key(event) {
    const step = 60;
    const act = {
      ArrowLeft: () => this.camera.drag(step, 0),
      ArrowRight: () => this.camera.drag(-step, 0),
      ArrowUp: () => this.camera.drag(0, step),
      ArrowDown: () => this.camera.drag(0, -step),
      "+": () => this.camera.zoom(1.5),
      "=": () => this.camera.zoom(1.5),
      "-": () => this.camera.zoom(1 / 1.5),
      0: () => this.camera.fit(this.box),
    }[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
    this.draw();
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = Math.min(2, devicePixelRatio || 1);
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.camera.resize(width, height, ratio);
    if (!this.fitted && width > 1) {
      this.fitted = true;
      this.camera.fit(this.box);
    }
    this.draw();
  }
}
