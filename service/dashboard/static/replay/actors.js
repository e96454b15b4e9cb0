/** Draws actors: boxes with a heading notch, discs for people, trails of two seconds; and lights on their stop lines. */

const TRAIL_S = 2;
const FADES = [0.07, 0.14, 0.24, 0.36]; // from the oldest quarter of a trail to the newest
const NOTICE_S = 3; // before and after an infraction its actor is outlined
const SMALLEST_PX = 6; // diameter of a person at any zoom

/** Draws the trails of all moving actors in four strokes, one per shade. */
export function drawTrails(c, drive, time_s, colours, px) {
  const ticks = Math.round(TRAIL_S / drive.dt);
  const now = Math.floor(time_s / drive.dt + 1e-6);
  c.lineCap = "butt";
  c.lineJoin = "round";
  for (let egos = 0; egos < 2; egos++) {
    c.strokeStyle = egos ? colours.accent : colours.actor;
    c.lineWidth = egos ? Math.max(0.9, 2 * px) : Math.max(0.35, px);
    for (let part = 0; part < FADES.length; part++) {
      c.globalAlpha = egos ? Math.min(1, 1.6 * FADES[part]) : FADES[part];
      c.beginPath();
      for (let i = 0; i < drive.count; i++) {
        const one = drive.tracks[i];
        if (!drive.shown[i] || (one.kind === "ego") !== (egos === 1)) continue;
        const from = now - ticks + Math.floor((part * ticks) / FADES.length) - one.first;
        const to = now - ticks + Math.floor(((part + 1) * ticks) / FADES.length) - one.first;
        const newest = part === FADES.length - 1;
        if (to < 0 || moved2(one, Math.max(0, from), Math.min(to, one.count - 1)) < 0.01) continue;
        c.moveTo(one.x[Math.max(0, from)], one.y[Math.max(0, from)]);
        for (let k = Math.max(0, from) + 1; k <= to && k < one.count; k++) c.lineTo(one.x[k], one.y[k]);
        if (newest) c.lineTo(drive.x[i], drive.y[i]);
      }
      c.stroke();
    }
  }
  c.globalAlpha = 1;
}

function moved2(one, from, to) {
  const dx = one.x[to] - one.x[from];
  const dy = one.y[to] - one.y[from];
  return dx * dx + dy * dy;
}

/** Draws all actors, people last. */
export function drawActors(c, drive, colours, px) {
  c.fillStyle = colours.actor;
  c.beginPath();
  for (let i = 0; i < drive.count; i++) if (isBox(drive, i)) box(c, drive, i, 0);
  c.fill();
  c.fillStyle = colours.notch;
  c.beginPath();
  for (let i = 0; i < drive.count; i++) if (isBox(drive, i)) notch(c, drive, i);
  c.fill();
  c.fillStyle = colours.accent;
  c.beginPath();
  for (let i = 0; i < drive.count; i++) if (drive.shown[i] && drive.tracks[i].kind === "ego") box(c, drive, i, 0);
  c.fill();
  c.strokeStyle = colours.page;
  c.lineWidth = px;
  c.stroke();
  c.fillStyle = colours.page;
  c.beginPath();
  for (let i = 0; i < drive.count; i++) if (drive.shown[i] && drive.tracks[i].kind === "ego") notch(c, drive, i);
  c.fill();
  c.fillStyle = colours.person;
  c.beginPath();
  for (let i = 0; i < drive.count; i++) {
    if (!drive.shown[i] || drive.tracks[i].kind !== "pedestrian") continue;
    const radius = Math.max(drive.tracks[i].width / 2, SMALLEST_PX * 0.5 * px);
    c.moveTo(drive.x[i] + radius, drive.y[i]);
    c.arc(drive.x[i], drive.y[i], radius, 0, 2 * Math.PI);
  }
  c.fill();
  c.strokeStyle = colours.page;
  c.stroke();
}

/** Outlines the actors of an infraction, shortly before and after it. */
export function drawInvolved(c, drive, infractions, time_s, colours, px) {
  c.strokeStyle = colours.infraction;
  c.lineWidth = 2 * px;
  c.beginPath();
  for (let n = 0; n < infractions.length; n++) {
    const one = infractions[n];
    if (!one.actor || Math.abs(one.time_s - time_s) > NOTICE_S) continue;
    for (let i = 0; i < drive.count; i++) {
      if (drive.shown[i] && drive.tracks[i].kind !== "ego" && drive.tracks[i].name === one.actor)
        box(c, drive, i, 3 * px);
    }
  }
  c.stroke();
}

/** Draws the lights on their stop lines: red thick, yellow dashed, green thin, since colour alone is not enough. */
export function drawSignals(c, drive, colours, px, dash) {
  for (let state = 1; state <= 3; state++) {
    c.strokeStyle = state === 1 ? colours.infraction : state === 2 ? colours.warning : colours.success;
    c.lineWidth = state === 3 ? Math.max(0.45, 1.5 * px) : Math.max(0.9, 3 * px);
    c.setLineDash(state === 2 ? dash.yellow : dash.solid);
    c.beginPath();
    for (let i = 0; i < drive.signals.length; i++) {
      const lamp = drive.signals[i];
      if (lamp.state !== state) continue;
      c.moveTo(lamp.line[0], lamp.line[1]);
      c.lineTo(lamp.line[2], lamp.line[3]);
    }
    c.stroke();
  }
  c.setLineDash(dash.solid);
}

function isBox(drive, i) {
  const kind = drive.tracks[i].kind;
  return drive.shown[i] && kind !== "pedestrian" && kind !== "ego";
}

/** Adds a track's box to the path, grown by some metres on each side. */
function box(c, drive, i, grown) {
  const u = drive.tracks[i].length / 2 + grown;
  const v = drive.tracks[i].width / 2 + grown;
  const x = drive.x[i];
  const y = drive.y[i];
  const ux = u * drive.cos[i];
  const uy = u * drive.sin[i];
  const vx = -v * drive.sin[i];
  const vy = v * drive.cos[i];
  c.moveTo(x + ux + vx, y + uy + vy);
  c.lineTo(x + ux - vx, y + uy - vy);
  c.lineTo(x - ux - vx, y - uy - vy);
  c.lineTo(x - ux + vx, y - uy + vy);
  c.closePath();
}

/** Adds the notch that shows the heading of a box: a wedge at its front. */
function notch(c, drive, i) {
  const length = drive.tracks[i].length;
  const v = drive.tracks[i].width * 0.36;
  const tip = length / 2 - 0.25;
  const base = Math.max(0, tip - Math.min(1.1, length * 0.3));
  const cos = drive.cos[i];
  const sin = drive.sin[i];
  c.moveTo(drive.x[i] + tip * cos, drive.y[i] + tip * sin);
  c.lineTo(drive.x[i] + base * cos - v * sin, drive.y[i] + base * sin + v * cos);
  c.lineTo(drive.x[i] + base * cos + v * sin, drive.y[i] + base * sin - v * cos);
  c.closePath();
}

/** Writes the names of the egos above them. */
export function drawNames(c, drive, camera, colours) {
  const { ratio } = camera;
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.font = '600 12px ui-monospace, "DejaVu Sans Mono", monospace';
  c.textAlign = "center";
  c.textBaseline = "bottom";
  c.lineWidth = 4;
  c.lineJoin = "round";
  c.strokeStyle = colours.page;
  c.fillStyle = colours.ink;
  for (let i = 0; i < drive.count; i++) {
    const one = drive.tracks[i];
    if (!drive.shown[i] || one.kind !== "ego") continue;
    const x = camera.left() / ratio + drive.x[i] * camera.scale;
    const y = camera.top() / ratio - drive.y[i] * camera.scale - 0.6 * one.length * camera.scale - 4;
    c.strokeText(one.name, x, y);
    c.fillText(one.name, x, y);
  }
  c.textAlign = "start";
}
