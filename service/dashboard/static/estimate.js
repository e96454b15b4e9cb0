/** Estimates: mean, interval and n as text and as a dot with a whisker; paired comparisons. */

import { h, s } from "./dom.js";
import { MISSING, interval, number } from "./format.js";

/**
 * @param {{mean: number|null, low: number|null, high: number|null, n: number}|undefined} estimate
 * @param {number} top upper end of the axis; the lower is 0 unless `bottom` is given
 */
export function whisker(estimate, top, { bottom = 0, reason = "none counts" } = {}) {
  if (!estimate || estimate.mean === null || estimate.mean === undefined) return missing(reason);
  const share = (value) => Math.min(1, Math.max(0, (value - bottom) / (top - bottom)));
  const at = (value) => `${(100 * share(value)).toFixed(2)}%`;
  const reach = [estimate.mean, estimate.low ?? estimate.mean, estimate.high ?? estimate.mean].map(share);
  const ends = estimate.low !== null && estimate.low !== undefined;
  return h(
    "div",
    { class: "measure" },
    h(
      "span",
      { class: "value" },
      h("b", {}, number(estimate.mean)),
      h("span", { class: "quiet" }, `${interval(estimate)} n=${estimate.n}`),
    ),
    s(
      "svg",
      { class: "whisker", "aria-hidden": "true", focusable: "false", "data-reach": reach.join(" ") },
      s("line", { class: "axis", x1: "0", x2: "100%", y1: 8, y2: 8 }),
      ["0", "50%", "100%"].map((x) => s("line", { class: "axis", x1: x, x2: x, y1: 4, y2: 12 })),
      bottom < 0 && s("line", { class: "zero", x1: at(0), x2: at(0), y1: 2, y2: 14 }),
      ends && s("line", { class: "reach", x1: at(estimate.low), x2: at(estimate.high), y1: 8, y2: 8 }),
      s("circle", { cx: at(estimate.mean), cy: 8, r: 4.5 }),
    ),
  );
}

/** The ends of a column's axis, for its header. */
export function scale(bottom, top) {
  return h(
    "span",
    { class: "scale-ends", "aria-hidden": "true", "data-ends": `${bottom} ${top}` },
    h("span", {}, number(bottom)),
    h("span", {}, number(top)),
  );
}

/** A dash for a missing value, with the reason on hover. */
export function missing(reason) {
  return h("span", { class: "missing", title: reason }, MISSING);
}

/** An estimate as columns of a CSV. */
export function estimateCells(name, estimate) {
  return {
    [name]: estimate?.mean ?? "",
    [`${name}_low`]: estimate?.low ?? "",
    [`${name}_high`]: estimate?.high ?? "",
    [`${name}_n`]: estimate?.n ?? "",
  };
}

const LONG = 16; // letters of a name beyond which it breaks anywhere, since it would widen its table

/** An agent's name with the colour it has on every page. */
export function agentName(name, colour, href = `/agents/${encodeURIComponent(name)}`) {
  return h(
    "span",
    { class: name.length > LONG ? "agent long" : "agent", style: { "--agent": colour ?? "var(--quiet)" } },
    h("span", { class: "dot-agent", "aria-hidden": "true" }),
    href ? h("a", { href }, name) : name,
  );
}

/** A probability with its event, such as `P(A > B) = 0.873`, or that few drives tell none; reports write the same. */
function probabilityText(event, probability) {
  if (probability === null) return "too few to decide";
  if (probability >= 0.9995) return `${event} >\u00a00.999`;
  if (probability < 0.0005) return `${event} <\u00a00.001`;
  return `${event} =\u00a0${probability.toFixed(3)}`;
}

/** Words of a comparison whose difference above 0 means a higher score of A, or a better one; a line breaks after them. */
const DIRECTIONS = {
  higher: { "<": "A is significantly lower", ">": "A is significantly higher", event: "P(A\u00a0>\u00a0B)" },
  better: { "<": "A is significantly worse", ">": "A is significantly better", event: "P(A\u00a0better)" },
};

/**
 * The verdict of a paired test as a sign, and the probability that A is higher or better than B.
 * @param comparison A - B, with `probability` that of a difference above 0; null: too few drives
 * @param {string} subject A and B in words
 * @param {"higher" | "better"} direction what a difference above 0 means
 */
export function verdict(comparison, subject, direction = "higher") {
  if (!comparison) return null;
  const { verdict: sign, probability, difference } = comparison;
  if (difference?.low === 0 && difference?.high === 0) {
    const title = `${subject}: equal everywhere`;
    return h("span", { class: "verdict even", title }, sign, h("span", { class: "quiet" }, " equal"));
  }
  const words = DIRECTIONS[direction];
  const title = `${subject}: ${words[sign] ?? "no significant difference"}`;
  return h(
    "span",
    { class: sign === "=" ? "verdict even" : "verdict", title },
    sign,
    h("span", { class: "quiet" }, ` ${probabilityText(words.event, probability)}`),
  );
}
