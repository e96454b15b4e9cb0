/** Mixed runs, whose egos have different agents: names, scores by agent, and the agents that met. */

import { h } from "./dom.js";
import { agentName, estimateCells, scale, whisker } from "./estimate.js";
import { shown } from "./scores.js";
import { copyButton, table } from "./table.js";

/** @typedef {{agent: string, version: number}} Driver */

/** Whether the egos of an evaluation or of an episode have different agents. */
export const isMixed = (one) => Object.keys(one.egos).length > 0;

/**
 * All agents of an evaluation, each version once, its own first.
 * @returns {Driver[]}
 */
export const driversOf = (one) => [
  ...new Map([own(one), ...Object.values(one.egos)].map((driver) => [`${driver.agent} ${driver.version}`, driver])).values(),
];

/** Their names. */
export const agentsOf = (one) => [...new Set(driversOf(one).map(({ agent }) => agent))];

/** The same in a sentence. */
export function agentsText(one) {
  const names = agentsOf(one);
  return names.length > 1 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : names[0];
}

/**
 * The agent of an ego.
 * @returns {Driver}
 */
export const driverOf = (one, ego) => one.egos[ego] ?? own(one);

const own = ({ agent, version, agent_version }) => ({ agent, version: version ?? agent_version });

/** The agents of a mixed run with their versions and egos, as parts of a line. */
export function driversLine(evaluation, colour) {
  const egos = {};
  for (const [ego, one] of Object.entries(evaluation.egos)) (egos[`${one.agent} v${one.version}`] ??= { one, own: [] }).own.push(ego);
  return [
    agentName(evaluation.agent, colour[evaluation.agent]),
    h("span", { class: "quiet" }, `version ${evaluation.version}, all other egos`),
    Object.values(egos).map(({ one, own }) => [
      agentName(one.agent, colour[one.agent]),
      h("span", { class: "quiet" }, `version ${one.version}, ${own.join(", ")}`),
    ]),
  ];
}

/** Scores of each agent of a mixed run, and the agents that met. */
export function byAgent(metrics, colour) {
  return [scores(metrics.agents, colour), met(metrics.meetings, colour)];
}

const named = (one, colour) => [agentName(one.agent, colour[one.agent]), h("span", { class: "quiet small plain" }, ` v${one.version}`)];

function scores(agents, colour) {
  const lost = agents.some((row) => row.lost > 0);
  const columns = [
    {
      title: "agent",
      cell: (row) => named(row, colour),
      csv: (row) => ({ agent: row.agent, version: row.version }),
    },
    { title: "egos", cell: (row) => row.egos.join(", ") || "—", csv: (row) => row.egos.join(" ") },
    ...shown(agents[0].scores, 4).map(({ key, title, unit, top }) => ({
      title,
      unit,
      css: "estimate",
      head: scale(0, top),
      cell: (row) => h("div", { style: { "--agent": colour[row.agent] ?? "var(--accent)" } }, estimates(row, key, top)),
      csv: (row) => estimateCells(key, row.scores[key]),
    })),
    lost && { title: "lost", unit: "drives", numeric: true, cell: (row) => row.lost },
  ].filter(Boolean);
  return h(
    "div",
    {},
    h("div", { class: "heading" }, h("h2", {}, "Scores by agent"), copyButton(columns, agents)),
    h("div", { class: "panel wide" }, table(columns, agents, { name: "agents", caption: "Scores by agent" })),
    h("p", { class: "note" }, "Each agent over its own drives. Agents of one run drive different missions: a second run with exchanged missions makes them comparable."),
  );
}

/** The estimate of a score; where drives were lost, also that which counts them as 0. */
function estimates(row, key, top) {
  if (!row.scores_lost_as_zero) return whisker(row.scores[key], top);
  return [
    whisker(row.scores[key], top),
    h("p", { class: "note" }, `counting ${row.lost} lost ${row.lost === 1 ? "drive" : "drives"} as 0`),
    whisker(row.scores_lost_as_zero[key], top),
  ];
}

function met(meetings, colour) {
  const columns = [
    { title: "agent", cell: ({ agents: [one] }) => named(one, colour), csv: ({ agents: [one] }) => `${one.agent} v${one.version}` },
    { title: "met", cell: ({ agents: [, one] }) => named(one, colour), csv: ({ agents: [, one] }) => `${one.agent} v${one.version}` },
    { title: "episodes", numeric: true, cell: (row) => row.episodes },
    { title: "collisions with each other", numeric: true, cell: (row) => row.collisions },
  ];
  if (!meetings.length) return null;
  return h(
    "div",
    { class: "sub" },
    h("div", { class: "heading" }, h("h3", {}, "Agents that met"), copyButton(columns, meetings)),
    h("div", { class: "panel wide" }, table(columns, meetings, { name: "met", caption: "Agents that met" })),
  );
}
