/** Camera: the part of the plane that a canvas shows. x to the right, y up, in metres; north is always up. */

const NEAREST = 60; // px per m
const FARTHEST = 0.2;

export class Camera {
  constructor() {
    this.x = 0;
    this.y = 0;
    this.scale = 7; // css px per m
    this.follow = true;
    this.width = 1; // css px
    this.height = 1;
    this.ratio = 1; // device px per css px
  }

  resize(width, height, ratio) {
    this.width = width;
    this.height = height;
    this.ratio = ratio;
  }

  lookAt(x, y) {
    this.x = x;
    this.y = y;
  }

  /** Sets the transform from metres to device pixels. Whole pixels keep the cached roads from shimmering. */
  apply(context) {
    const s = this.scale * this.ratio;
    context.setTransform(s, 0, 0, -s, this.left(), this.top());
  }

  /** Device px of the network's origin. */
  left() {
    return Math.round(this.width * this.ratio * 0.5 - this.x * this.scale * this.ratio);
  }

  top() {
    return Math.round(this.height * this.ratio * 0.5 + this.y * this.scale * this.ratio);
  }

  /** Zooms by a factor around a point of the canvas (css px), or around the ego while following it. */
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const scale = Math.min(NEAREST, Math.max(FARTHEST, this.scale * factor));
    if (!this.follow) {
      const dx = px - this.width / 2;
      const dy = py - this.height / 2;
      this.x += dx / this.scale - dx / scale;
      this.y -= dy / this.scale - dy / scale;
    }
    this.scale = scale;
  }

  /** Moves the camera with the pointer, css px; it then no longer follows the ego. */
  drag(dx, dy) {
    this.follow = false;
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  /** Shows a whole box [x0, y0, x1, y1], m. */
  fit([x0, y0, x1, y1]) {
    this.follow = false;
    this.lookAt((x0 + x1) / 2, (y0 + y1) / 2);
    const scale = Math.min(this.width / Math.max(1, x1 - x0), this.height / Math.max(1, y1 - y0)) * 0.94;
    this.scale = Math.min(NEAREST, Math.max(FARTHEST, scale));
  }
}

/**
 * Lets pointer, wheel and fingers move a camera. Once the camera is free, the canvas takes vertical swipes as well;
 * before that they scroll the page.
 */
export function steer(canvas, camera, changed) {
  const pointers = new Map();
  let spread = 0;

  const moved = () => {
    canvas.classList.toggle("free", !camera.follow);
    changed();
  };
  canvas.addEventListener("pointerdown", (event) => {
    pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    canvas.setPointerCapture(event.pointerId);
    spread = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const dx = event.offsetX - before[0];
    const dy = event.offsetY - before[1];
    pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (pointers.size === 1) camera.drag(dx, dy);
    if (pointers.size === 2) {
      const [a, b] = [...pointers.values()];
      const now = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (spread > 0) camera.zoom(now / spread, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
      spread = now;
    }
    moved();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => {
      pointers.delete(event.pointerId);
      spread = 0;
    });
  }
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      camera.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), event.offsetX, event.offsetY);
      moved();
    },
    { passive: false },
  );
}
