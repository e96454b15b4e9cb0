/** Labels and marks of infractions and outcomes of statuses, which the server writes into every page. */

import { seconds } from "./format.js";

const source = document.getElementById("words");

/** @type {{marks: Object<string, {label: string, path: string}>, endings: Object<string, string>}} */
export const words = source ? JSON.parse(source.textContent) : { marks: {}, endings: {} };

/** The label of a kind of infraction. */
export const label = (kind) => words.marks[kind]?.label ?? kind.replaceAll("_", " ");

/** Whether the ego caused a collision, in words; empty of other kinds of infraction, and where it was never noted. */
export const fault = ({ at_fault: own }) => (own === true ? "at fault" : own === false ? "not at fault" : "");

/** An infraction in a line, such as `vehicle hit (not at fault) at 3.1 s`. */
export const infractionText = (one) =>
  [label(one.kind), fault(one) && `(${fault(one)})`, `at ${seconds(one.time_s)} s`].filter(Boolean).join(" ");

/** A status without the word before its colon, which repeats its colour and sign. */
export const ending = (status) =>
  status
    .split(": ")
    .pop()
    .replace(/^agent('s)? /, "");

/** The outcome of a status: success, infraction, warning or infrastructure. */
export const meaning = (status) => words.endings[status] ?? "infrastructure";

export const SIGNS = { success: "✓", infraction: "✕", warning: "!", infrastructure: "∅", running: "▸", waiting: "·" };
