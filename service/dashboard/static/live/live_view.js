/** A live world on a canvas: connects to its events, draws its scenes, and keeps a toolbar and a table of egos. */

import { get, listen } from "../api.js";
import { h } from "../dom.js";
import { CameraControls, isForPage } from "../replay/camera_controls.js";
import { roads } from "../replay/player.js";
import { ruler, stage as frame } from "../replay/stage.js";
import { View } from "../replay/view.js";
import { LiveClock } from "./live_clock.js";
import { LiveDrive } from "./live_drive.js";

/**
 * Shows a live world in `place` until it ends.
 * @param {HTMLElement} place
 * @param world its document
 * @param {{tools: Node[], keys: Object<string, () => void>, scene: (scene: any) => void, state: (state: any) => void,
 *   end: (end: any) => void, notice: {tell: (error?: Error) => void, clear: () => void}}} page what the page adds, and is told
 * @returns {{choose: (name: string) => void}}
 */
export function watch(place, world, page) {
  let shown = null; // once the first scene is there
  let drive = null;
  const path = `/v1/worlds/${encodeURIComponent(world.id)}`;
  const heard = {
    stage: (stage) => (drive ??= new LiveDrive(stage)),
    scene: async (scene) => {
      const first = drive.tick < 0;
      drive.add(scene);
      page.scene(scene);
      if (first) shown = await draw(place, world, drive, page);
      shown?.clock.follow(drive.newest); // before that, the roads are being read
    },
    plans: (plans) => drive && (drive.plans = plans),
    state: page.state,
    end: (end) => {
      stop();
      page.end(end);
    },
  };
  const reread = async () => {
    const now = await get(path);
    if (now.finished) heard.end(now);
    else page.state(now);
    return !now.finished;
  };
  const hear = (data, name) => heard[name](data);
  const stop = listen(`${path}/events`, Object.keys(heard), { hear, reread, notice: page.notice });
  return {
    choose(name) {
      const ego = drive?.egos.find((one) => one.name === name);
      if (!shown || !ego) return;
      shown.view.choose(ego);
      shown.clock.request();
    },
  };
}

/** Puts the canvas and its toolbar in place. */
async function draw(place, world, drive, page) {
  const map = await roads(world.network, drive.bounds);
  const clock = new LiveClock(drive.dt);
  const { element, canvas, ruler: bar } = frame(map, `World ${world.scenario}, live, seen from above. Space pauses, f follows the ego.`);
  place.replaceChildren(element);
  let view = null;
  clock.onFrame(() => view && (view.plan = drive.planOf(view.ego))); // before the view draws
  view = new View(canvas, drive, map, clock);
  const cameras = new CameraControls([view], "route", () => clock.request());
  view.onCamera = () => cameras.show();
  clock.onFrame(() => ruler(bar, view.camera));
  place.append(h("div", { class: "controls", role: "toolbar", "aria-label": "World" }, page.tools, cameras.element));
  addEventListener("keydown", (event) => {
    const act = isForPage(event) && ({ ...cameras.keys, ...page.keys })[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  return { clock, view };
}
