/** A chart of a score over the versions of an agent: a dot with its interval for each, on one axis that can be zoomed. */

import { h, s } from "./dom.js";
import { estimateText, number } from "./format.js";

const [WIDTH, HEIGHT, LEFT, TOP, BOTTOM] = [640, 200, 48, 12, 28];

/**
 * @param {{version: number, href: string, estimate: {mean: number, low: number, high: number, n: number}}[]} points in
 *   the order of their versions
 * @param {{title: string, unit: string, top: number}} score
 */
export function overVersions(points, score) {
  const place = h("div", {});
  const zoom = h("button", { type: "button", "aria-pressed": "false" }, "zoom the scale");
  zoom.addEventListener("click", () => {
    const zoomed = zoom.getAttribute("aria-pressed") !== "true";
    zoom.setAttribute("aria-pressed", String(zoomed));
    place.replaceChildren(chart(points, score, zoomed));
  });
  place.append(chart(points, score, false));
  return h("div", {}, h("div", { class: "heading sub" }, h("h3", {}, `${score.title} over versions`, h("span", { class: "unit" }, ` ${score.unit}`)), zoom), h("div", { class: "panel" }, place));
}

function chart(points, { title, top }, zoomed) {
  const ends = points.flatMap(({ estimate: one }) => [one.mean, one.low ?? one.mean, one.high ?? one.mean]);
  const room = Math.max(0.05 * (Math.max(...ends) - Math.min(...ends)), top / 200);
  const [low, high] = zoomed ? [Math.min(...ends) - room, Math.max(...ends) + room] : [0, top];
  const y = (value) => HEIGHT - BOTTOM - ((value - low) / (high - low)) * (HEIGHT - BOTTOM - TOP);
  const x = (i) => LEFT + ((i + 0.5) / points.length) * (WIDTH - LEFT - 12);
  const said = points.map(({ version, estimate }) => `v${version}: ${estimateText(estimate)}`).join("; ");
  return s(
    "svg",
    { class: "versions-chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "group", "aria-label": `${title}: ${said}` },
    [low, (low + high) / 2, high].map((value) => [
      s("line", { class: "axis", x1: LEFT, x2: WIDTH - 12, y1: y(value), y2: y(value) }),
      s("text", { x: LEFT - 8, y: y(value) + 4, "text-anchor": "end" }, number(value)),
    ]),
    s("polyline", { points: points.map(({ estimate }, i) => `${x(i)},${y(estimate.mean)}`).join(" ") }),
    points.map(({ version, href, estimate }, i) =>
      s(
        "a",
        { href },
        s("title", {}, `v${version}: ${estimateText(estimate)}`),
        typeof estimate.low === "number" && s("line", { class: "reach", x1: x(i), x2: x(i), y1: y(estimate.low), y2: y(estimate.high) }),
        s("circle", { cx: x(i), cy: y(estimate.mean), r: 5 }),
        s("text", { x: x(i), y: HEIGHT - 8, "text-anchor": "middle" }, `v${version}`),
      ),
    ),
  );
}
