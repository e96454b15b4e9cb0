/** A replay on a page: loads the drive and the roads, and makes views, controls and timelines. */

import { get } from "../api.js";
import { h } from "../dom.js";
import { address, readAddress, writer } from "./address.js";
import { Clock } from "./clock.js";
import { Controls } from "./controls.js";
import { Drive } from "./drive.js";
import { ruler, stage } from "./stage.js";
import { Timeline, Zoom } from "./timeline.js";
import { View } from "./view.js";

const AROUND_M = 120;

/** Reads the replay of an episode and the roads around it; a parking lot has none. */
export const load = (episode) => loadFrom(`/v1/episodes/${encodeURIComponent(episode)}/replay`);

/** Reads a replay from its path, and the roads around it. */
export async function loadFrom(path) {
  const replay = await get(path);
  return { replay, map: replay.lot ? { lot: replay.lot } : await roads(replay.network, replay.bounds) };
}

/** The roads around a box; without the network there are none, and the map says why. */
export async function roads(network, [x0, y0, x1, y1]) {
  const box = new URLSearchParams({ x0: x0 - AROUND_M, y0: y0 - AROUND_M, x1: x1 + AROUND_M, y1: y1 + AROUND_M });
  try {
    return await get(`/v1/networks/${encodeURIComponent(network)}/map?${box}`);
  } catch (error) {
    console.warn(error);
    return { lanes: [], junctions: [], stop_lines: [], missing: error.message };
  }
}

/**
 * Shows one replay in `place`, or several side by side that share clock, keys and zoom.
 * @param {HTMLElement} place
 * @param {{replay: any, map: any, agent: string, title?: Node}[]} loaded `agent` is the name that the submission has here
 * @param {AbortSignal} [signal] stops them, so that others may take their place
 */
export function play(place, loaded, signal) {
  const drives = loaded.map(({ replay }) => new Drive(replay));
  const clock = new Clock(Math.max(...drives.map((drive) => drive.duration)), drives[0].dt);
  const given = readAddress();
  const { names } = drives[0];
  const stages = loaded.map(({ replay, map, agent, title }) => stage(map, label(replay, agent), title));
  const timelines = h("div", { class: "timelines" });
  place.replaceChildren(
    h(
      "div",
      { class: loaded.length > 1 ? "stages paired" : "stages" },
      stages.map((one) => one.element),
    ),
  );

  const views = stages.map(({ canvas }, i) => new View(canvas, drives[i], loaded[i].map, clock, signal));
  const chosen = () => (drives[0].egos.length > 1 ? views[0].ego.name : null);
  const link = () => address(clock, views[0].camera, chosen());
  const write = writer(link, signal);
  const controls = new Controls(clock, views, link, signal);
  signal?.addEventListener("abort", () => clock.stop());
  for (const view of views) follow(view, given);
  if (loaded[0].map.lot && given.z === null) controls.cameras.whole();
  let shown = [];
  const zoom = new Zoom(() => clock.request());
  const show = () => {
    shown = views.map((view) => new Timeline(view.ego, clock, zoom, names.mark));
    const name = (i) => (views.length > 1 ? h("h3", {}, loaded[i].agent) : "");
    timelines.replaceChildren(zoom.element, ...shown.flatMap((one, i) => [name(i), one.element]));
  };
  show();
  clock.onFrame((time_s) => {
    for (let i = 0; i < shown.length; i++) shown[i].show(time_s);
  });
  for (const [i, view] of views.entries()) {
    view.onCamera = () => {
      for (const other of views) if (other !== view) other.camera.scale = view.camera.scale;
      controls.cameras.show();
      write();
    };
    clock.onFrame((time_s) => {
      ruler(stages[i].ruler, view.camera);
      stages[i].ended.hidden = time_s <= drives[i].duration + 1e-6;
    });
  }
  clock.onChange(write);
  place.append(controls.element, timelines, h("p", { class: "note keys" }, help(names)));
  controls.cameras.show();
  clock.seek(given.t ?? 0);
  const player = {
    clock,
    views,
    controls,
    onEgo: () => {}, // is told the ego that is shown from now on
    choose(name) {
      for (const view of views) {
        const ego = view.drive.egos.find((one) => one.name === name);
        if (ego) view.choose(ego);
      }
      show();
      clock.seek(clock.time);
      player.onEgo(views[0].ego);
    },
  };
  const move = () => {
    const now = readAddress();
    if (now.ego !== null && now.ego !== views[0].ego.name) player.choose(now.ego);
    for (const view of views) follow(view, now);
    clock.seek(now.t ?? clock.time);
    controls.cameras.show();
  };
  addEventListener("hashchange", move, { signal });
  return player;
}

/** Sets the ego and camera of a view from the address. */
function follow(view, given) {
  const ego = view.drive.egos.find((one) => one.name === given.ego);
  if (ego) view.choose(ego);
  if (given.z) view.camera.scale = Math.min(60, Math.max(0.2, given.z));
  view.camera.follow = given.x === null || given.y === null;
  if (!view.camera.follow) view.camera.lookAt(given.x, given.y);
  view.canvas.classList.toggle("free", !view.camera.follow);
}

const label = (replay, agent) =>
  `Replay of ${agent} on ${replay.scenario}, seen from above. Space plays, arrow keys step, i goes to the next ${replay.lot ? "contact" : "infraction"}.`;

function help({ whole, mark }) {
  const keys = [
    ["space", "play or pause"],
    ["← →", "step a tick, with Shift a second"],
    ["i", `next ${mark}`],
    ["f", "follow the ego"],
    ["0", `whole ${whole}`],
    ["+ −", "zoom"],
    ["< >", "speed"],
  ];
  return keys.flatMap(([key, does], i) => [i ? " · " : "", h("kbd", {}, key), ` ${does}`]);
}
