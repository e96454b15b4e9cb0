/** Draws the roads to a canvas larger than the view, and again only when the view leaves it or zooms. */

const MARGIN = 0.3; // of the view's size, on each side
const MARKING_M = 0.3;
const STRIPES_M = [0.55, 0.55];

export class Scene {
  /** @param map geometry from /v1/networks/NAME/map */
  constructor(map) {
    this.layers = {};
    for (const kind of ["walk", "bicycle", "drive", "internal", "crossing"]) {
      this.layers[kind] = byWidth(map.lanes.filter((lane) => lane.kind === kind));
    }
    this.junctions = new Path2D();
    for (const outline of map.junctions) polyline(this.junctions, outline, true);
    this.stopLines = new Path2D();
    for (const [x1, y1, x2, y2] of map.stop_lines)
      polyline(
        this.stopLines,
        [
          [x1, y1],
          [x2, y2],
        ],
        false,
      );
    this._canvas = document.createElement("canvas");
    this._context = this._canvas.getContext("2d", { alpha: false });
    this.forget();
  }

  /** Forces a new drawing next time, such as in other colours. */
  forget() {
    this._scale = 0;
    this._left = 0;
    this._top = 0;
  }

  /** Copies the roads to a context without transform, device px. */
  draw(context, camera, colours) {
    const width = Math.round(camera.width * camera.ratio);
    const height = Math.round(camera.height * camera.ratio);
    if (!width || !height) return; // the page has no layout yet
    const dx = camera.left() - this._left;
    const dy = camera.top() - this._top;
    const spareX = Math.round(width * MARGIN);
    const spareY = Math.round(height * MARGIN);
    const stale = this._scale !== camera.scale * camera.ratio || this._canvas.width !== width + 2 * spareX;
    if (stale || this._canvas.height !== height + 2 * spareY || Math.abs(dx) > spareX || Math.abs(dy) > spareY) {
      this._paint(camera, colours, width, height, spareX, spareY);
      context.drawImage(this._canvas, -spareX, -spareY);
      return;
    }
    context.drawImage(this._canvas, dx - spareX, dy - spareY);
  }

  _paint(camera, colours, width, height, spareX, spareY) {
    if (this._canvas.width !== width + 2 * spareX || this._canvas.height !== height + 2 * spareY) {
      this._canvas.width = width + 2 * spareX;
      this._canvas.height = height + 2 * spareY;
    }
    this._scale = camera.scale * camera.ratio;
    this._left = camera.left();
    this._top = camera.top();
    const c = this._context;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = colours.page;
    c.fillRect(0, 0, this._canvas.width, this._canvas.height);
    c.setTransform(this._scale, 0, 0, -this._scale, this._left + spareX, this._top + spareY);
    c.lineJoin = "round";
    this._bands(c, "walk", colours.walk, 0);
    c.fillStyle = colours.lane;
    c.fill(this.junctions);
    this._bands(c, "bicycle", colours.edge, 0);
    this._bands(c, "drive", colours.edge, 0);
    this._bands(c, "internal", colours.lane, 0);
    this._bands(c, "bicycle", colours.walk, MARKING_M);
    this._bands(c, "drive", colours.lane, MARKING_M);
    c.setLineDash(STRIPES_M);
    this._bands(c, "crossing", colours.stripe, 0);
    c.setLineDash([]);
    c.strokeStyle = colours.stripe;
    c.lineWidth = 0.4;
    c.stroke(this.stopLines);
  }

  _bands(context, kind, colour, narrower) {
    context.strokeStyle = colour;
    for (const [width, path] of this.layers[kind]) {
      context.lineWidth = Math.max(0.5, width - narrower);
      context.stroke(path);
    }
  }
}

/** [width, Path2D] pairs: all centrelines of one width in one path. */
function byWidth(lanes) {
  const paths = new Map();
  for (const lane of lanes) {
    const width = Math.round(lane.width * 10) / 10;
    if (!paths.has(width)) paths.set(width, new Path2D());
    polyline(paths.get(width), lane.points, false);
  }
  return [...paths];
}

/** Adds a line through points to a path; a closed line is an outline. */
export function polyline(path, points, closed) {
  points.forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
  if (closed) path.closePath();
}
