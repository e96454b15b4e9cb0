/** Numbers and times, written as in reports. */

export const MISSING = "—";

/** Three significant digits in plain notation. */
export function number(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return MISSING;
  const size = Math.abs(value);
  if (size < 5e-4) return "0";
  if (size >= 999.5) return value.toFixed(0);
  const text = value.toPrecision(3);
  return text.includes("e") ? value.toFixed(5) : text;
}

/** An interval, such as `[75.9, 80.6]`; empty where there is none. */
export function interval(estimate) {
  if (estimate.low === null || estimate.low === undefined) return "";
  return `[${number(estimate.low)}, ${number(estimate.high)}]`;
}

/** An estimate in one line, such as `78.4 [75.9, 80.6] n=75`. */
export function estimateText(estimate) {
  if (!estimate || estimate.mean === null) return MISSING;
  return [number(estimate.mean), interval(estimate), `n=${estimate.n}`].filter(Boolean).join(" ");
}

/** Seconds as m:ss.s, or s.s below a minute. */
export function seconds(value) {
  const tenths = Math.round(value * 10);
  const minutes = Math.floor(tenths / 600);
  const rest = ((tenths - 600 * minutes) / 10).toFixed(1);
  return minutes ? `${minutes}:${rest.padStart(4, "0")}` : rest;
}

/** A duration such as `3 min 20 s`. */
export function span(seconds_) {
  const s = Math.max(0, Math.round(seconds_));
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${s % 60} s`;
  const minutes = Math.round(s / 60);
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** A moment in the reader's own time zone, such as `2026-03-01 14:05`. */
export function moment(iso) {
  if (!iso) return MISSING;
  const at = new Date(iso);
  const two = (n) => String(n).padStart(2, "0");
  return `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())} ${two(at.getHours())}:${two(at.getMinutes())}`;
}

/** The versions of dohyo that drove a run, such as `dohyo 0.1.0 and dohyo 0.2.0`. */
export const softwareText = ({ dohyo_versions: versions }) =>
  versions.map((one) => (one === "earlier" ? "an earlier dohyo" : `dohyo ${one}`)).join(" and ");

/** The first characters of a hash, enough to distinguish versions. */
export const short = (hash) => (hash ? hash.slice(0, 8) : MISSING);
