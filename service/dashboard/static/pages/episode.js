/** One episode: its replay, its score factor by factor, and the reasons of its agent. */

import { get, page } from "../api.js";
import { byId, fill, h, mark } from "../dom.js";
import { agentName } from "../estimate.js";
import { number, seconds, short } from "../format.js";
import { colours, subject } from "../subject.js";
import { SIGNS, ending, label, meaning, words } from "../words.js";
import { explain, explainClosedLoop } from "../replay/score.js";
import { load, play } from "../replay/player.js";
import { parked } from "../replay/parked.js";
import { Reasons } from "../replay/reasons.js";

page(async () => {
  const id = subject();
  const episode = await get(`/v1/episodes/${encodeURIComponent(id)}`);
  document.title = `${nameOf(episode)} · dohyo`;
  if (!episode.record_hash) {
    fill(byId("content"), heading(episode, []), waiting(episode));
    return;
  }
  const { replay, map } = await load(id);
  const colour = await colours([episode.agent]);
  const facts = h("aside", { class: "facts-panel", "aria-label": "Why this score" });
  const theatre = h("section", { class: "theatre", "aria-label": "Replay" });
  fill(
    byId("content"),
    heading(episode, [agentName(episode.agent, colour[episode.agent])]),
    h("div", { class: "episode" }, theatre, facts),
  );
  const player = play(theatre, [{ replay, map, agent: episode.agent }]);
  const reasons = h("section", { class: "reasons", "aria-label": "Why the agent decides so" });
  const show = (ego) =>
    fill(
      facts,
      egoChoice(replay, player, show),
      ...why(ego, replay, player, episode),
      replay.lot ? null : [h("h2", {}, "Why the agent decides so"), reasons],
      links(id, episode),
    );
  show(player.views[0].ego);
  if (!replay.lot) new Reasons(id, player, reasons);
});

/** Name of an episode; all lots are one scenario. */
const nameOf = (episode) => (episode.cell === "lot" ? `lot ${episode.seed}` : episode.scenario);

function heading(episode, agent) {
  return h(
    "div",
    { class: "title" },
    h(
      "p",
      { class: "crumbs quiet" },
      h(
        "a",
        { href: `/evaluations/${encodeURIComponent(episode.evaluation)}` },
        `${episode.agent} on ${episode.benchmark}`,
      ),
      " / episode",
    ),
    h("h1", {}, nameOf(episode)),
    h(
      "p",
      { class: "byline" },
      agent,
      h("span", { class: "quiet" }, "seed ", h("span", { class: "number" }, String(episode.seed))),
      episode.network && h("span", { class: "quiet" }, `on ${episode.network}`),
    ),
  );
}

function waiting(episode) {
  const text =
    {
      queued: "It is waiting for a worker.",
      running: "It is being driven; the replay is available when it has ended.",
      lost: "It was lost to a fault of the infrastructure or a gridlock, not to the agent. It counts in no score, except means that count lost drives as 0.",
      cancelled: "Its evaluation was cancelled before it was driven.",
    }[episode.status] ?? "It has no record.";
  return h(
    "section",
    { class: "state" },
    h("h2", {}, `This episode is ${episode.status}`),
    h("p", {}, text),
    episode.failure && h("p", { class: "quiet" }, episode.failure),
  );
}

function egoChoice(replay, player, show) {
  if (replay.egos.length < 2) return null;
  const choice = h(
    "select",
    {
      change: () => {
        player.choose(choice.value);
        show(player.views[0].ego);
      },
    },
    replay.egos.map((ego) =>
      h("option", { value: ego.name, selected: ego.name === player.views[0].ego.name }, ego.name),
    ),
  );
  return h("p", {}, h("label", {}, replay.lot ? "kart " : "ego ", choice));
}

function why(ego, replay, player, episode) {
  const closed = episode.summary?.egos.find((one) => one.name === ego.name)?.closed_loop;
  const kind = meaning(ego.status);
  return [
    h("p", { class: `status large ${kind}` }, h("i", { "aria-hidden": "true" }, SIGNS[kind]), ending(ego.status)),
    ego.failure && h("p", { class: "reason" }, ego.failure),
    h("h2", {}, ego.parking ? "How it parked" : "Why this score"),
    ego.parking ? parked(ego) : closed ? explainClosedLoop(closed) : explain(ego, replay.rules),
    h("h2", {}, titleOf(ego)),
    h(
      "ol",
      { class: "infractions" },
      ego.infractions.map((one) =>
        h(
          "li",
          {},
          h(
            "button",
            { type: "button", class: "row", click: () => player.clock.seek(one.time_s) },
            mark(one.kind, words.marks[one.kind].path, one.at_fault === false),
            h("span", {}, h("b", {}, label(one.kind)), h("span", { class: "quiet detail" }, detail(one))),
            h("time", {}, `${seconds(one.time_s)} s`),
          ),
        ),
      ),
    ),
  ];
}

function titleOf(ego) {
  const what = ego.parking ? "contact" : "infraction";
  return ego.infractions.length ? `${what[0].toUpperCase()}${what.slice(1)}s (${ego.infractions.length})` : `No ${what}`;
}

function detail(one) {
  const fault = one.at_fault === null || one.at_fault === undefined ? "" : one.at_fault ? "at fault" : "not at fault";
  return [one.magnitude ? `${number(one.magnitude)} ${one.unit}` : "", one.actor ?? "", fault]
    .filter(Boolean)
    .join(" · ");
}

function links(id, episode) {
  const base = `/v1/episodes/${encodeURIComponent(id)}`;
  return h(
    "p",
    { class: "links" },
    h("a", { href: `${base}/record` }, "record"),
    " · ",
    h("a", { href: `${base}/trajectory` }, "trajectory"),
    " · ",
    h("a", { href: `${base}/replay` }, "replay as JSON"),
    h("br"),
    h(
      "span",
      { class: "quiet" },
      "record hash ",
      h("code", { title: episode.record_hash }, short(episode.record_hash)),
    ),
  );
}
