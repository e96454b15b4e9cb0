/** One world: live while it lives, its replay afterwards. */

import { get, page, send } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { moment, seconds, short } from "../format.js";
import { joinedBy } from "../live/instructions.js";
import { watch } from "../live/live_view.js";
import { standing } from "../live/standing.js";
import { staleNotice } from "../notice.js";
import { chosenEgo, why } from "../replay/facts.js";
import { loadFrom, play } from "../replay/player.js";
import { subject } from "../subject.js";

const MAY_CHANGE = ["submitter", "organiser", "admin"];
const path = () => `/v1/worlds/${encodeURIComponent(subject())}`;

page(async () => {
  const [world, me] = await Promise.all([get(path()), get("/v1/me")]);
  document.title = `${world.scenario} · dohyo`;
  if (!world.finished) live(world, MAY_CHANGE.includes(me.role));
  else if (world.record_hash) await replay(world);
  else fill(byId("content"), heading(world), over(world));
});

function heading(world) {
  return h(
    "div",
    { class: "title" },
    h("p", { class: "crumbs quiet" }, h("a", { href: "/worlds" }, "worlds"), " / ", h("code", {}, world.id)),
    h("h1", {}, world.scenario),
    h(
      "p",
      { class: "byline" },
      h("span", { class: "quiet" }, "seed ", h("span", { class: "number" }, String(world.seed))),
      h("span", { class: "quiet" }, `on ${world.network}`),
      h("span", { class: "quiet" }, `made ${moment(world.created)}`),
    ),
  );
}

/** The page of a live world. */
function live(world, mayChange) {
  const status = h("p", { role: "status" });
  const egos = h("ul", { class: "egos" });
  const problem = h("p", { class: "problem", role: "alert" });
  const notice = staleNotice();
  const join = h("section", {});
  const facts = h("aside", { class: "facts-panel", "aria-label": "Drivers" }, status, problem, notice.element, h("h2", {}, "Egos"), egos, join);
  const theatre = h("section", { class: "theatre", "aria-label": "Live view" }, h("p", { class: "loading waiting" }, "Waiting for the first scene …"));
  fill(byId("content"), heading(world), h("div", { class: "episode" }, theatre, facts));

  const act = (what, body) => async () => {
    problem.textContent = "";
    try {
      showState(await send("POST", `${path()}/${what}`, body));
    } catch (error) {
      problem.textContent = error.message;
    }
  };
  const tools = toolbar(act, mayChange);
  let state = null;
  let chosen = null;
  const showState = (next) => {
    state = next;
    fill(status, standing(state.status, "large"));
    tools.show(state.status);
    showEgos();
    const free = state.egos.find((ego) => ego.driving && !ego.driver);
    fill(join, free ? [h("h2", {}, "Join"), h("p", { class: "small quiet" }, `Drive ${free.name} with a worker of your own:`), joinedBy(world, free.name)] : "");
  };
  const rows = new Map(); // by name of the ego; they stay, so that the focus does
  const rowOf = (name) => {
    if (!rows.has(name)) rows.set(name, egoRow(name, () => {
      chosen = name;
      view.choose(name);
      showEgos();
    }));
    return rows.get(name);
  };
  const showEgos = () => {
    chosen = chosen ?? state.egos[0]?.name;
    for (const ego of state.egos) {
      const row = rowOf(ego.name);
      if (!row.element.isConnected) egos.append(row.element);
      row.show(ego, ego.name === chosen);
    }
  };
  const view = watch(theatre, world, {
    tools: tools.elements,
    keys: mayChange ? tools.keys : {},
    state: showState,
    notice,
    scene(scene) {
      tools.time.textContent = `${seconds(scene.time_s)} s`;
      tools.time.title = `tick ${scene.tick}`;
      scene.egos.forEach(([, , , speed], i) => {
        const row = rows.get(state?.egos[i].name);
        if (row) row.speed.textContent = speed.toFixed(1);
      });
    },
    async end() {
      const ended = await get(path());
      tools.show("");
      fill(facts, over(ended));
    },
  });
  showState(world);
}

/** An ego with its driver and its speed; a press on it moves the camera there. */
function egoRow(name, choose) {
  const speed = h("span", { class: "number speed", title: "speed, m/s" });
  const unit = h("span", { class: "unit" }, "m/s");
  const driver = h("span", { class: "quiet detail" });
  const button = h("button", { type: "button", class: "row", click: choose }, h("span", {}, h("b", {}, name), driver), speed, unit);
  return {
    element: h("li", {}, button),
    speed,
    show(ego, isChosen) {
      button.setAttribute("aria-pressed", String(isChosen));
      driver.textContent = ego.driver ?? (ego.driving ? "no driver" : "has ended");
      speed.hidden = unit.hidden = !ego.driving;
    },
  };
}

/** Buttons that pause, step and end a world, for those who may. */
function toolbar(act, mayChange) {
  const time = h("span", { class: "clock number" });
  const button = (text, title, press) => h("button", { type: "button", title, click: press }, text);
  const [pause, resume] = [act("pause"), act("resume")];
  let status = "";
  const toggle = button("resume", "resume or pause (space)", () => (status === "running" ? pause() : resume()));
  const steps = [1, 10].map((ticks) => button(ticks === 1 ? "1 tick" : `${ticks} ticks`, `go on for ${ticks}`, act("step", { ticks })));
  const end = button("end", "end the world; its record says so", act("end"));
  return {
    time,
    elements: mayChange ? [h("div", { class: "group" }, toggle, steps), time, h("div", { class: "group" }, end)] : [time],
    keys: { " ": () => toggle.click(), ArrowRight: () => steps[0].click() },
    show(now) {
      status = now;
      toggle.textContent = status === "running" ? "pause" : "resume";
      toggle.disabled = !["running", "paused", "waiting"].includes(status);
      for (const one of steps) one.disabled = status !== "paused";
      end.disabled = !status;
    },
  };
}

/** What is said of a world that has ended. */
function over(world) {
  return h(
    "div",
    { class: "ended-world" },
    h("p", { role: "status" }, standing(world.status, "large")),
    world.reason && h("p", { class: "reason" }, world.reason),
    h("p", { class: "quiet" }, `It ended ${moment(world.finished)}, after `, h("span", { class: "number" }, seconds(world.time_s)), " s."),
    world.record_hash
      ? h("p", {}, h("a", { class: "button", href: location.pathname }, "open the replay"))
      : h("p", { class: "quiet" }, world.recorded ? "Its record could not be written." : "It was not recorded."),
  );
}

/** The page of a world that was recorded. */
async function replay(world) {
  const loaded = await loadFrom(`${path()}/replay`);
  const facts = h("aside", { class: "facts-panel", "aria-label": "Why this score" });
  const theatre = h("section", { class: "theatre", "aria-label": "Replay" });
  fill(byId("content"), heading(world), h("div", { class: "episode" }, theatre, facts));
  const player = play(theatre, [{ ...loaded, agent: "the drivers" }]);
  fill(
    facts,
    h("p", { role: "status" }, standing(world.status), h("span", { class: "quiet" }, " · no ranking")),
    world.reason && h("p", { class: "reason" }, world.reason),
    chosenEgo(loaded.replay, player, (ego) => why(ego, loaded.replay, player)),
    links(world),
  );
}

function links(world) {
  return h(
    "p",
    { class: "links" },
    h("a", { href: `${path()}/record` }, "record"),
    " · ",
    h("a", { href: `${path()}/trajectory` }, "trajectory"),
    " · ",
    h("a", { href: `${path()}/replay` }, "replay as JSON"),
    h("br"),
    h("span", { class: "quiet" }, "record hash ", h("code", { title: world.record_hash }, short(world.record_hash))),
  );
}
