/** Tables made from columns, sorted, filtered and searched by the reader, with a copy as CSV. */

import { h } from "./dom.js";
import { interactive } from "./shared/interactive.js";

/**
 * @typedef {{title: string, unit?: string, key?: string, numeric?: boolean, css?: string, choice?: boolean,
 *   cell: (row: any) => any, csv?: ((row: any) => any) | null, sort?: (row: any) => any, head?: any}} Column
 */

/**
 * A table of rows with its tools. The first column names its row.
 * @param {Column[]} columns `choice` gives a column a filter; `csv: null` is a column of controls, which is not sorted
 * @param {any[]} rows
 * @param {{name: string, caption?: string, css?: string}} options `name` is the table's prefix in the address
 */
export function table(columns, rows, options) {
  const { name, caption, css = "" } = options;
  const element = h(
    "table",
    { class: css },
    caption && h("caption", { class: "sr" }, caption),
    h("thead", {}, h("tr", {}, columns.map(header))),
    body(columns, rows),
  );
  const frame = interactive(element, name);
  made.set(frame, options);
  return frame;
}

const made = new WeakMap(); // the options of each table, by its frame

/** Shows other rows in the table of `place` and in its copy button; false if it has no table with as many columns. */
export function renewed(place, columns, rows) {
  const shown = place.querySelector(".interactive");
  if (shown?.querySelector("thead tr").cells.length !== columns.length) return false;
  replaceKeepingFocus(place.querySelector(".copy"), copyButton(columns, rows));
  refresh(shown, columns, rows);
  return true;
}

/** Replaces the rows of a table that is shown; what the reader has chosen stays, the focus too. */
function refresh(shown, columns, rows) {
  const element = shown.querySelector("table");
  const focused = shown.contains(document.activeElement) ? document.activeElement : null;
  element.tBodies[0].replaceWith(body(columns, rows));
  element.dispatchEvent(new Event("rows"));
  const frame = columns.map((column, place) => column.choice && offered(shown, column, place)).includes(false)
    ? rebuilt(shown, columns, rows)
    : shown;
  if (!focused || focused === document.activeElement) return;
  const same = focused.isConnected ? focused : [...frame.querySelectorAll(focused.localName)].find((one) => one.isEqualNode(focused));
  same?.focus({ preventScroll: true });
}

/** Adds the values of a column that its filter lacks; false if it needs a filter and has none. */
function offered(shown, { title }, place) {
  const cells = [...shown.querySelector("tbody").rows].map((row) => row.cells[place]);
  const values = [...new Set(cells.map((one) => one.dataset.value ?? one.textContent.trim()))];
  const filter = shown.querySelector(`.table-tools select[aria-label="${CSS.escape(title)}"]`);
  if (!filter) return values.length < 2;
  const known = new Set([...filter.options].map((one) => one.value));
  filter.append(...values.filter((value) => !known.has(value)).map((value) => h("option", { value }, value)));
  return true;
}

/** Makes a table anew in its place, so that it has all filters. What the reader has chosen is in the address. */
function rebuilt(shown, columns, rows) {
  const frame = table(columns, rows, made.get(shown));
  shown.replaceWith(frame);
  return frame;
}

function replaceKeepingFocus(before, after) {
  const focused = before === document.activeElement;
  before.replaceWith(after);
  if (focused) after.focus({ preventScroll: true });
}

function header(column) {
  const { title, unit, key, csv, choice, head } = column;
  const marks = { "data-key": key, "data-plain": csv === null, "data-choice": choice };
  return h("th", { scope: "col", class: classes(column), ...marks }, title, unit && h("span", { class: "unit" }, ` ${unit}`), head);
}

function body(columns, rows) {
  return h(
    "tbody",
    {},
    rows.map((row) => h("tr", row.attributes ?? {}, columns.map((column, place) => cell(column, row, place)))),
  );
}

function cell(column, row, place) {
  const attributes = { class: classes(column), "data-value": sortValue(column, row) };
  if (place === 0) return h("th", { scope: "row", ...attributes }, column.cell(row));
  const label = [column.title, column.unit].filter(Boolean).join(" ");
  return h("td", { ...attributes, "data-label": label }, whole(column.cell(row)));
}

/** What a row is sorted by: what the CSV has, of several values the first. */
function sortValue({ sort, csv }, row) {
  const value = sort ? sort(row) : csv?.(row);
  const one = value !== null && typeof value === "object" ? Object.values(value)[0] : value;
  return one === undefined && !csv && !sort ? null : (one ?? "");
}

/** Several nodes in one element, so that a cell on a narrow screen has one label and one value. */
const whole = (content) => (Array.isArray(content) ? h("div", {}, content) : content);

function classes(column) {
  return [column.numeric && "numeric", column.css].filter(Boolean).join(" ") || null;
}

/** A button that copies the rows as CSV (RFC 4180). */
export function copyButton(columns, rows) {
  const button = h("button", { type: "button", class: "copy" }, "copy as CSV");
  button.addEventListener("click", async () => {
    await copyText(csv(columns, rows));
    button.textContent = "copied";
    setTimeout(() => (button.textContent = "copy as CSV"), 1500);
  });
  return button;
}

/** The rows as CSV. A column with `csv: null` is left out; one whose `csv` returns an object gives several columns. */
export function csv(columns, rows) {
  const lines = rows.map((row) => {
    const line = {};
    for (const column of columns) {
      if (column.csv === null) continue;
      const value = column.csv ? column.csv(row) : column.cell(row);
      if (value !== null && typeof value === "object") Object.assign(line, value);
      else line[column.key ?? column.title] = value;
    }
    return line;
  });
  const names = [...new Set(lines.flatMap(Object.keys))];
  return (
    [names, ...lines.map((line) => names.map((name) => line[name]))]
      .map((cells) => cells.map(quoted).join(","))
      .join("\r\n") + "\r\n"
  );
}

function quoted(value) {
  let text = value === null || value === undefined ? "" : String(value);
  if (/^[=+@\t\r]/.test(text) || (text.startsWith("-") && Number.isNaN(Number(text)))) text = `'${text}`; // no formulas
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** Copies text, also where the page does not come from a secure origin. */
export async function copyText(text) {
  if (navigator.clipboard && window.isSecureContext) return navigator.clipboard.writeText(text);
  const area = h("textarea", { class: "sr" }, text);
  document.body.append(area);
  area.select();
  document.execCommand("copy");
  area.remove();
}
