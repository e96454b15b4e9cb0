/** Tables made from columns, for wide and narrow screens, with a copy as CSV. */

import { h } from "./dom.js";

/**
 * @typedef {{title: string, unit?: string, key?: string, numeric?: boolean, css?: string,
 *   cell: (row: any) => any, csv?: ((row: any) => any) | null, head?: any}} Column
 */

/** A table of rows. The first column names its row. */
export function table(columns, rows, { caption, css = "" } = {}) {
  const head = columns.map((column) =>
    h(
      "th",
      { scope: "col", class: classes(column) },
      column.title,
      column.unit && h("span", { class: "unit" }, ` ${column.unit}`),
      column.head,
    ),
  );
  const body = rows.map((row) =>
    h(
      "tr",
      row.attributes ?? {},
      columns.map((column, place) =>
        place === 0
          ? h("th", { scope: "row", class: classes(column) }, column.cell(row))
          : h(
              "td",
              { class: classes(column), "data-label": [column.title, column.unit].filter(Boolean).join(" ") },
              whole(column.cell(row)),
            ),
      ),
    ),
  );
  return h(
    "table",
    { class: css },
    caption && h("caption", { class: "sr" }, caption),
    h("thead", {}, h("tr", {}, head)),
    h("tbody", {}, body),
  );
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
