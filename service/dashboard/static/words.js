/** The project's words and marks, put into every page by the server, so that they exist in one place. */

const source = document.getElementById("words");

/** @type {{marks: Object<string, {label: string, path: string}>, endings: Object<string, string>}} */
export const words = source ? JSON.parse(source.textContent) : { marks: {}, endings: {} };

/** What an infraction is called. */
export const label = (kind) => words.marks[kind]?.label ?? kind.replaceAll("_", " ");

/** A status without the word before its colon, which colour and sign already say. */
export const ending = (status) =>
  status
    .split(": ")
    .pop()
    .replace(/^agent('s)? /, "");

/** What a drive's status means: success, infraction, warning or infrastructure. */
export const meaning = (status) => words.endings[status] ?? "infrastructure";

export const SIGNS = { success: "✓", infraction: "✕", warning: "!", infrastructure: "∅", running: "▸", waiting: "·" };
