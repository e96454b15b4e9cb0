for (const element of document.querySelectorAll(".copy[hidden], .json[hidden], .tools[hidden], .ruler[hidden]")) {
  element.hidden = false;
}

/* Tables as CSV */

async function copy(text) {
  if (navigator.clipboard) {
    return navigator.clipboard.writeText(text);
  }
  const area = document.body.appendChild(document.createElement("textarea"));
  area.value = text;
  area.select();
  document.execCommand("copy");
  area.remove();
}

for (const button of document.querySelectorAll(".copy")) {
  const label = button.textContent;
  button.setAttribute("aria-live", "polite");
  button.addEventListener("click", async () => {
    const rows = button.dataset.csv.trimEnd().split("\n").length - 1;
    await copy(button.dataset.csv);
    button.textContent = `copied ${rows} rows`;
    setTimeout(() => { button.textContent = label; }, 2000);
  });
}

for (const table of document.querySelectorAll("table[data-name]")) interactive(table, table.dataset.name);

/* Figures, in the colours of the page */

const templates = JSON.parse(document.getElementById("plotly-templates").textContent);
const dark = matchMedia("(prefers-color-scheme: dark)");

const ZOOMING = {
  displaylogo: false,
  displayModeBar: true,
  doubleClick: "reset",
  modeBarButtons: [["zoomIn2d", "zoomOut2d", "resetScale2d"]],
  responsive: true,
};

function draw(figure) {
  const { data, layout } = JSON.parse(figure.querySelector("script").textContent);
  layout.template = templates[dark.matches ? "dark" : "light"];
  layout.dragmode = matchMedia("(pointer: fine)").matches ? "zoom" : false; // a finger scrolls the page
  Plotly.react(figure.querySelector(".plot"), data, layout, ZOOMING);
}

const figures = document.querySelectorAll(".figures figure");
figures.forEach(draw);
dark.addEventListener("change", () => figures.forEach(draw));

for (const button of document.querySelectorAll(".json")) {
  button.addEventListener("click", () => {
    const text = button.closest("figure").querySelector("script").textContent;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.download = button.dataset.name;
    link.click();
    URL.revokeObjectURL(link.href);
  });
}

/* Maps: move, zoom, describe the infraction under the pointer */

function readBox(text) {
  const [x, y, width, height] = text.split(" ").map(Number);
  return { x, y, width, height };
}

const CROWD_PX = 20;
const CLOSEST = 0.03; // m per px; at this zoom, a mark that stands for several leads to its drive

/** The mark nearest to the mean place of all, which itself may lie beside the road. */
function central(crowd) {
  const mean = (axis) => crowd.reduce((sum, one) => sum + one[axis], 0) / crowd.length;
  const [x, y] = [mean("x"), mean("y")];
  const far = (one) => Math.hypot(one.x - x, one.y - y);
  return crowd.reduce((best, one) => (far(one) < far(best) ? one : best)).spot;
}

class RoadMap {
  constructor(figure) {
    this.figure = figure;
    this.svg = figure.querySelector(".roads");
    this.tip = figure.querySelector(".tip");
    this.ruler = figure.querySelector(".ruler");
    this.pointers = new Map();
    this.dragged = false;
    this.spots = [...figure.querySelectorAll(".spot")];
    for (const spot of this.spots) {
      const title = spot.querySelector("title");
      spot.setAttribute("aria-label", title.textContent);
      title.remove();
      spot.number = spot.querySelector(".pin").appendChild(document.createElementNS(this.svg.namespaceURI, "text"));
      spot.number.setAttribute("x", 8);
      spot.number.setAttribute("y", -5);
    }
    this.listen();
    this.show(readBox(figure.dataset.home));
  }

  listen() {
    const svg = this.svg;
    svg.addEventListener("wheel", (event) => this.onWheel(event), { passive: false });
    svg.addEventListener("pointerdown", (event) => this.onDown(event));
    svg.addEventListener("pointermove", (event) => this.onMove(event));
    for (const type of ["pointerup", "pointercancel", "pointerleave"]) {
      svg.addEventListener(type, (event) => this.pointers.delete(event.pointerId));
    }
    svg.addEventListener("click", (event) => { if (this.dragged) event.preventDefault(); }, true);
    svg.addEventListener("dragstart", (event) => event.preventDefault());
    svg.addEventListener("keydown", (event) => this.onKey(event));
    for (const type of ["pointerover", "focusin"]) {
      svg.addEventListener(type, (event) => this.name(event.target.closest(".spot")));
    }
    for (const type of ["pointerleave", "focusout"]) {
      svg.addEventListener(type, () => this.name(null));
    }
    for (const button of this.figure.querySelectorAll(".tools button")) {
      button.addEventListener("click", () => {
        if (button.dataset.zoom) this.zoom(Number(button.dataset.zoom));
        else this.show(readBox(this.figure.dataset[button.dataset.view]));
      });
    }
    svg.addEventListener("click", (event) => this.onClick(event));
    this.figure.addEventListener("change", () => this.count());
    new ResizeObserver(() => this.show(this.box)).observe(svg);
  }

  /** Of marks of one kind and agent that would overlap, one is drawn, at its true place, with their number. */
  count() {
    this.counted = this.scale;
    const near = CROWD_PX * this.scale;
    const crowds = [];
    for (const spot of this.spots) {
      if (getComputedStyle(spot).display === "none") continue;
      const { e: x, f: y } = spot.transform.baseVal.consolidate().matrix;
      const fits = ([one]) => one.spot.dataset.crowd === spot.dataset.crowd && Math.hypot(one.x - x, one.y - y) < near;
      const crowd = crowds.find(fits);
      if (crowd) crowd.push({ spot, x, y });
      else crowds.push([{ spot, x, y }]);
    }
    for (const crowd of crowds) {
      const first = central(crowd);
      for (const { spot } of crowd) {
        spot.classList.toggle("behind", spot !== first);
        spot.crowd = spot === first ? crowd.length : 1;
        spot.number.textContent = spot.crowd > 1 ? String(spot.crowd) : "";
      }
    }
  }

  /** A mark that stands for several is zoomed in; the link of a single mark leads to its drive. */
  onClick(event) {
    const spot = event.target.closest(".spot");
    if (!spot || !(spot.crowd > 1) || this.scale < CLOSEST || event.detail === 0) return;
    event.preventDefault();
    const { e: x, f: y } = spot.transform.baseVal.consolidate().matrix;
    this.zoom(0.3, { x, y });
  }

  /** Metres per pixel. */
  get scale() {
    return Math.max(this.box.width / this.svg.clientWidth, this.box.height / this.svg.clientHeight);
  }

  /** Network coordinates (y down) under a point of the window. */
  at(clientX, clientY) {
    return new DOMPoint(clientX, clientY).matrixTransform(this.svg.getScreenCTM().inverse());
  }

  show(box) {
    this.box = box;
    if (!this.svg.clientWidth) return;
    this.svg.setAttribute("viewBox", `${box.x} ${box.y} ${box.width} ${box.height}`);
    this.svg.style.setProperty("--k", this.scale * (this.svg.clientWidth < 600 ? 0.75 : 1));
    if (this.counted !== this.scale) this.count();
    const longest = 120 * this.scale;
    const power = 10 ** Math.floor(Math.log10(longest));
    const length = power * [5, 2, 1].find((step) => step * power <= longest);
    this.ruler.style.width = `${length / this.scale}px`;
    this.ruler.firstElementChild.textContent = length < 1000 ? `${length} m` : `${length / 1000} km`;
  }

  zoom(factor, centre) {
    const { x, y, width, height } = this.box;
    const fixed = centre ?? { x: x + width / 2, y: y + height / 2 };
    const limited = Math.max(factor, 20 / width);
    this.show({
      x: fixed.x + (x - fixed.x) * limited,
      y: fixed.y + (y - fixed.y) * limited,
      width: width * limited,
      height: height * limited,
    });
  }

  pan(dx, dy) {
    this.show({ ...this.box, x: this.box.x - dx * this.scale, y: this.box.y - dy * this.scale });
  }

  /* The wheel scrolls the page until the map is clicked; with Ctrl it always zooms the map. */
  onWheel(event) {
    if (!event.ctrlKey && !this.svg.contains(document.activeElement)) return;
    event.preventDefault();
    this.zoom(1.0015 ** event.deltaY, this.at(event.clientX, event.clientY));
  }

  onDown(event) {
    this.dragged = false;
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  onMove(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY };
    if (!this.dragged && Math.hypot(now.x - before.x, now.y - before.y) < 4) return;
    if (!this.dragged) this.svg.setPointerCapture(event.pointerId);
    this.dragged = true;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const reach = (point) => Math.max(1, Math.hypot(point.x - other.x, point.y - other.y));
      this.zoom(reach(before) / reach(now), this.at((now.x + other.x) / 2, (now.y + other.y) / 2));
    } else {
      this.pan(now.x - before.x, now.y - before.y);
    }
    this.pointers.set(event.pointerId, now);
  }

  onKey(event) {
    const step = 64;
    const acts = {
      ArrowLeft: () => this.pan(step, 0),
      ArrowRight: () => this.pan(-step, 0),
      ArrowUp: () => this.pan(0, step),
      ArrowDown: () => this.pan(0, -step),
      "+": () => this.zoom(0.5),
      "=": () => this.zoom(0.5),
      "-": () => this.zoom(2),
      i: () => this.jump(1),
      I: () => this.jump(-1),
      Escape: () => this.svg.focus(),
    };
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in acts)) return;
    event.preventDefault();
    acts[event.key]();
  }

  /** Moves the map to the next infraction that the legend shows. */
  jump(step) {
    const shown = this.spots.filter((spot) => getComputedStyle(spot).display !== "none");
    if (!shown.length) return;
    const here = shown.indexOf(document.activeElement);
    const next = shown[here < 0 ? 0 : (here + step + shown.length) % shown.length];
    const { e: x, f: y } = next.transform.baseVal.consolidate().matrix;
    const { width, height } = this.box;
    this.show({ x: x - width / 2, y: y - height / 2, width, height });
    next.classList.remove("behind");
    next.focus({ preventScroll: true });
  }

  name(spot) {
    this.tip.hidden = !spot;
    if (!spot) return;
    const more = spot.crowd > 1 ? `\nand ${spot.crowd - 1} more of this kind: press to zoom in` : "";
    this.tip.textContent = spot.getAttribute("aria-label") + more;
    const frame = this.svg.getBoundingClientRect();
    const mark = spot.getBoundingClientRect();
    const left = Math.min(mark.right - frame.left + 8, frame.width - this.tip.offsetWidth - 8);
    const below = mark.bottom - frame.top + 8;
    const fits = below + this.tip.offsetHeight < frame.height;
    this.tip.style.left = `${Math.max(8, left)}px`;
    this.tip.style.top = `${fits ? below : mark.top - frame.top - this.tip.offsetHeight - 8}px`;
  }
}

document.querySelectorAll(".map").forEach((figure) => new RoadMap(figure));

/* A mark on a map links to a drive whose row may be hidden */

addEventListener("hashchange", () => document.getElementById(location.hash.slice(1))?.scrollIntoView());
