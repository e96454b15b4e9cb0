/** Scores by their names in the interface: title, unit, upper end of the axis. */

const PERCENT = ["%", 100];
const SCORES = {
  driving_score: ["driving score DS", ...PERCENT],
  route_completion: ["route completion RC", ...PERCENT],
  infraction_penalty: ["penalty IP", "0-1", 1],
  irs: ["infraction rate score IRS", ...PERCENT],
  success: ["success", ...PERCENT],
  nocrash_success: ["success without crash", ...PERCENT],
  drove_2500m: ["2500 m without crash", ...PERCENT],
  closed_loop: ["closed-loop score", ...PERCENT],
  no_collision: ["no collision NC", ...PERCENT],
  drivable_area: ["on the road DAC", ...PERCENT],
  driving_direction: ["own direction DDC", ...PERCENT],
  making_progress: ["makes progress MP", ...PERCENT],
  time_to_collision: ["time to collision TTC", ...PERCENT],
  speed_limit: ["speed limit SL", ...PERCENT],
  progress: ["progress EP", ...PERCENT],
  comfort: ["comfort C", ...PERCENT],
};
export const FREEWAY = {
  speed_std_mps: ["spread of speeds", "m/s", 10],
  throughput_vph: ["throughput", "vehicles/h", 8000],
  speed_mps: ["mean speed", "m/s", 40],
  speed_std_within_mps: ["spread within segments", "m/s", 10],
  fuel_circles_g_km: ["fuel of the connected cars", "g/km", 100],
};
const KMH = ["km/h", 20];
const SCALED = ["× 10³", 20];
export const FORECAST = {
  mse: ["error of three minutes", ...SCALED],
  mse_1: ["error, t+1 min", ...SCALED],
  mse_2: ["error, t+2 min", ...SCALED],
  mse_3: ["error, t+3 min", ...SCALED],
  rmse_1: ["RMSE, t+1 min", ...KMH],
  rmse_2: ["RMSE, t+2 min", ...KMH],
  rmse_3: ["RMSE, t+3 min", ...KMH],
  mse_true: ["error against all vehicles", ...SCALED],
};
const PARKING = {
  success: ["success", ...PERCENT],
  aligned: ["aligned, of successes", ...PERCENT],
  time_s: ["time to park", "s", 60],
  contacts: ["contacts", ...PERCENT],
  timed_out: ["out of time", ...PERCENT],
};
const OPEN = ["driving_score", "route_completion", "irs", "success", "infraction_penalty", "nocrash_success"];
const CLOSED = ["closed_loop", "no_collision", "drivable_area", "progress", "time_to_collision", "comfort"];

const LOWER = new Set(["speed_std_mps", "speed_std_within_mps", "fuel_circles_g_km", "time_s", "contacts", "timed_out", ...Object.keys(FORECAST)]);

/** How good a value of a score is, from 0 to 1; 0 where there is none. */
export function goodness(value, { top, lower }) {
  if (!Number.isFinite(value)) return 0;
  const share = Math.min(1, Math.max(0, value / top));
  return lower ? 1 - share : share;
}

/** Title, unit and upper end of the axis of a score, and whether lower values are better. */
export function scoreOf(key) {
  const [title, unit, top] = SCORES[key] ?? FREEWAY[key] ?? PARKING[key] ?? FORECAST[key] ?? [key, ...PERCENT];
  return { key, title, unit, top, lower: LOWER.has(key) };
}

/** Whether drives have infractions: not mornings, lots and days of forecasts. */
export const hasInfractions = (scores) => !("aligned" in scores || "mse" in scores || "speed_std_mps" in scores);

/** The scores to show of drives, mornings, lots or days, by those that they have, or by their headline where they have none. */
function keysOf(scores, headline) {
  if ("closed_loop" in scores) return CLOSED;
  if ("speed_std_mps" in scores || headline in FREEWAY) return Object.keys(FREEWAY);
  if ("mse" in scores || headline in FORECAST) return Object.keys(FORECAST);
  return "aligned" in scores ? Object.keys(PARKING) : OPEN;
}

/** The scores to show, at most `most`, the most important first; `headline`, if given, before all others. */
export function shown(scores, most, headline = null) {
  const keys = keysOf(scores, headline);
  return [...new Set([headline ?? keys[0], ...keys])].slice(0, most).map(scoreOf);
}
