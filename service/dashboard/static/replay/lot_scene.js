/** Draws a parking lot: spots, walls, blocks, parked cars, and the ways of pedestrians. */

import { polyline } from "./scene.js";

const WALL_M = 0.25;
const SPOT_M = 0.1;
const FREE_M = 0.22;
const LETTER = new Path2D("M-.45 -.7h.25v.5h.2a.45 .45 0 0 1 0 .9h-.45zM-.2 .05v.42h.18a.2 .2 0 0 0 0 -.42z"); // a P, y up

export class LotScene {
  /** @param lot of a replay: walls, blocks, cars, spots and walks, in metres and radians */
  constructor({ walls, blocks, cars, spots, walks }) {
    this.walls = lines(walls);
    this.walks = lines(walks);
    this.blocks = boxes(blocks);
    this.cars = boxes(cars);
    this.taken = boxes(spots.filter((one) => !one.free).map((one) => one.box));
    this.free = boxes(spots.filter((one) => one.free).map((one) => one.box));
    this.letters = spots.filter((one) => one.free).map((one) => one.box);
  }

  /** Nothing is kept: a lot has some dozens of shapes. */
  forget() {}

  /** Draws the lot to a context without transform, device px. */
  draw(context, camera, colours) {
    const c = context;
    c.fillStyle = colours.page;
    c.fillRect(0, 0, c.canvas.width, c.canvas.height);
    camera.apply(c);
    const px = 1 / camera.scale;
    c.lineJoin = "miter";
    this._stroke(c, this.taken, colours.edge, Math.max(SPOT_M, px));
    c.fillStyle = colours.walk;
    c.fill(this.free);
    this._stroke(c, this.free, colours.success, Math.max(FREE_M, 1.5 * px));
    this._letters(c, colours.success);
    c.setLineDash([0.5, 0.5]);
    this._stroke(c, this.walks, colours.edge, Math.max(SPOT_M, px));
    c.setLineDash([]);
    c.fillStyle = colours.actor;
    c.fill(this.cars);
    c.fillStyle = colours.ink;
    c.fill(this.blocks);
    this._stroke(c, this.walls, colours.ink, Math.max(WALL_M, 1.5 * px));
  }

  _stroke(c, path, colour, width) {
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.stroke(path);
  }

  /** A letter in each free spot, since colour alone is not enough. */
  _letters(c, colour) {
    c.fillStyle = colour;
    for (const [x, y] of this.letters) {
      c.save();
      c.translate(x, y);
      c.fill(LETTER, "evenodd");
      c.restore();
    }
  }
}

function lines(ends) {
  const path = new Path2D();
  for (const [x0, y0, x1, y1] of ends) polyline(path, [[x0, y0], [x1, y1]], false);
  return path;
}

/** Outlines of boxes, each given as centre, heading, length and width. */
function boxes(rows) {
  const path = new Path2D();
  for (const [x, y, heading, length, width] of rows) {
    const [ux, uy] = [(length / 2) * Math.cos(heading), (length / 2) * Math.sin(heading)];
    const [vx, vy] = [(-width / 2) * Math.sin(heading), (width / 2) * Math.cos(heading)];
    const corners = [[ux + vx, uy + vy], [ux - vx, uy - vy], [-ux - vx, -uy - vy], [vx - ux, vy - uy]];
    polyline(path, corners.map(([dx, dy]) => [x + dx, y + dy]), true);
  }
  return path;
}
