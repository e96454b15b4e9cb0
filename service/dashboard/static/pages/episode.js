/** One episode: its replay, its score factor by factor, and the reasons of its agent. */

import { get, page } from "../api.js";
import { byId, fill, h } from "../dom.js";
import { agentName } from "../estimate.js";
import { short } from "../format.js";
import { measuredBy, measuredEpisode } from "../measured.js";
import { agentsOf, agentsText, driverOf, isMixed } from "../mixed.js";
import { colours, subject } from "../subject.js";
import { chosenEgo, why } from "../replay/facts.js";
import { load, play } from "../replay/player.js";
import { Reasons } from "../replay/reasons.js";

page(async () => {
  const id = subject();
  const episode = await get(`/v1/episodes/${encodeURIComponent(id)}`);
  document.title = `${nameOf(episode)} · dohyo`;
  if (!episode.record_hash) {
    fill(byId("content"), heading(episode, []), waiting(episode));
    return;
  }
  const colour = await colours(agentsOf(episode));
  if (measuredBy(episode)) {
    fill(byId("content"), heading(episode, [agentName(episode.agent, colour[episode.agent])]), measuredEpisode(episode));
    return;
  }
  const { replay, map } = await load(id);
  const facts = h("aside", { class: "facts-panel", "aria-label": "Why this score" });
  const theatre = h("section", { class: "theatre", "aria-label": "Replay" });
  fill(
    byId("content"),
    heading(episode, agentsOf(episode).map((agent) => agentName(agent, colour[agent]))),
    h("div", { class: "episode" }, theatre, facts),
  );
  const player = play(theatre, [{ replay, map, agent: episode.agent }]);
  const reasons = h("section", { class: "reasons", "aria-label": "Why the agent decides so" });
  fill(
    facts,
    chosenEgo(replay, player, (ego) => [
      isMixed(episode) && driven(episode, ego, colour),
      ...why(ego, replay, player, closedLoop(episode, ego)),
    ]),
    replay.lot ? null : [h("h2", {}, "Why the agent decides so"), reasons],
    links(id, episode),
  );
  if (!replay.lot) new Reasons(id, player, reasons);
});

/** The agent of an ego of a mixed run. */
function driven(episode, ego, colour) {
  const { agent, version } = driverOf(episode, ego.name);
  return h("p", {}, agentName(agent, colour[agent]), h("span", { class: "quiet small" }, ` version ${version}`));
}

/** Name of an episode; all lots are one scenario. */
const nameOf = (episode) => (episode.cell === "lot" ? `lot ${episode.seed}` : episode.scenario);

/** The closed-loop score of an ego, where its benchmark has one. */
const closedLoop = (episode, ego) => episode.summary?.egos.find((one) => one.name === ego.name)?.closed_loop;

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
        `${agentsText(episode)} on ${episode.benchmark}`,
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
      lost: "It was lost to a fault of the infrastructure, not to the agent. It counts in no score, except means that count lost drives as 0.",
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
