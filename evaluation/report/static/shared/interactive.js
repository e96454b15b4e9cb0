/**
 * Makes an HTML table interactive: sorting, filters, search, a zoom of its scales, and long tables in part.
 * The state is in the address, so that a copied link shows the same rows. The report and the dashboard share this file.
 *
 * What the markup says: `data-value` of a cell is what it sorts by, else its text; `data-key` of a header is its name
 * in the address; `data-plain` leaves a column unsorted; `data-choice` gives a column a filter; a row of class `sub`
 * stays below the row above it; `data-reach="share low high"` of an SVG element is a dot with its whisker.
 */

const MOST = 40; // rows that are shown at first
const MOST_NARROW = 12;
const SEARCHED = 4; // fewer rows than this are read faster than searched
const NARROW = "(max-width: 720px)";

const known = new WeakMap(); // by table; one that has left the page is forgotten, which a listener of its own would prevent

/** Shows the rows of all tables on the page anew. */
function applyAll() {
  for (const table of document.querySelectorAll(".interactive > table")) known.get(table)?._apply();
}

matchMedia(NARROW).addEventListener("change", applyAll);
addEventListener("hashchange", applyAll);

/**
 * Makes a table interactive; `name` is its prefix in the address, unique on the page.
 * @returns {HTMLElement} the table with its tools around it, in the table's place
 */
export function interactive(table, name) {
  const frame = make("div", { class: "interactive" });
  table.replaceWith(frame);
  const { tools, more } = new Interactive(table, name);
  frame.append(tools, table, more);
  return frame;
}

class Interactive {
  constructor(table, name) {
    this.table = table;
    this.name = name;
    this.columns = [...table.tHead.rows[0].cells].map(columnOf);
    this.given = readAddress();
    this.fields = new Map(); // by name in the address
    this.count = make("output", { class: "quiet number" });
    this.more = make("button", { type: "button", class: "more" });
    this.more.addEventListener("click", () => this._set("all", this._get("all") ? "" : "1"));
    this.tools = make("div", { class: "table-tools" });
    this._read();
    this._addHeaders();
    this._addTools();
    table.addEventListener("rows", () => this._renew());
    known.set(table, this);
    this._apply();
  }

  /** Reads the rows; a row of class `sub` belongs to the row above it. */
  _read() {
    this.groups = [];
    for (const row of this.table.tBodies[0]?.rows ?? []) {
      if (row.classList.contains("sub") && this.groups.length) this.groups.at(-1).push(row);
      else this.groups.push([row]);
    }
  }

  _renew() {
    this._read();
    this._apply();
  }

  _get(key) {
    return this.given.get(`${this.name}.${key}`) ?? "";
  }

  _set(key, value) {
    if (value) this.given.set(`${this.name}.${key}`, value);
    else this.given.delete(`${this.name}.${key}`);
    writeAddress(`${this.name}.${key}`, value);
    this._apply();
  }

  _addHeaders() {
    for (const column of this.columns.filter((one) => one.sorts)) {
      const button = make("button", { type: "button", class: "sorter", title: "sort by this column" });
      const named = [...column.head.childNodes].filter((node) => !node.classList?.contains("scale-ends"));
      button.append(...named, make("span", { class: "arrow", "aria-hidden": "true" }));
      column.head.prepend(button);
      button.addEventListener("click", () => this._set("sort", this._next(column)));
    }
  }

  /** The order after a press: numbers begin with the greatest, texts with the first; the third press gives the original order. */
  _next({ key, index }) {
    const numeric = this.groups.some(([row]) => typeof valueOf(row.cells[index]) === "number");
    const [first, second] = numeric ? [`-${key}`, key] : [key, `-${key}`];
    const now = this._get("sort");
    return now === first ? second : now === second ? "" : first;
  }

  _addTools() {
    const { tools, groups } = this;
    if (groups.length >= SEARCHED || this._get("find")) {
      const field = make("input", { type: "search", placeholder: "search", "aria-label": "search in this table" });
      field.addEventListener("input", () => this._set("find", field.value.trim()));
      this.fields.set("find", field);
      tools.append(field);
    }
    for (const column of this.columns.filter((one) => one.choice)) this._addFilter(column);
    if (groups.length > 1) this._addSort();
    if (this.table.querySelector("[data-reach]")) {
      this.zoom = make("button", { type: "button", class: "zoom" }, "zoom the scales");
      this.zoom.addEventListener("click", () => this._set("zoom", this._get("zoom") ? "" : "1"));
      tools.append(this.zoom);
    }
    tools.append(this.count);
  }

  _addFilter({ key, title, index }) {
    const values = new Set(this.groups.map(([row]) => choiceOf(row.cells[index])));
    if (values.size < 2 && !this._get(key)) return;
    const field = choice(title, [["", "all"], ...[...values].sort(compare).map((one) => [one, one])]);
    field.element.addEventListener("change", () => this._set(key, field.element.value));
    this.fields.set(key, field.element);
    this.tools.append(field.label);
  }

  /** A choice of the order, for narrow screens, where the table has no header. */
  _addSort() {
    const options = this.columns
      .filter((one) => one.sorts)
      .flatMap(({ key, title }) => [[key, `${title} ↑`], [`-${key}`, `${title} ↓`]]);
    const field = choice("sort by", [["", "as given"], ...options]);
    field.label.classList.add("narrow-only");
    field.element.addEventListener("change", () => this._set("sort", field.element.value));
    this.fields.set("sort", field.element);
    this.tools.append(field.label);
  }

  _apply() {
    for (const [key, field] of this.fields) if (field.value.trim() !== this._get(key)) field.value = this._get(key);
    const kept = this._sorted(this.groups.filter((group) => this._fits(group)));
    const most = matchMedia(NARROW).matches ? MOST_NARROW : MOST;
    const shown = this._get("all") ? kept.length : Math.min(kept.length, most);
    for (const group of this.groups) for (const row of group) row.hidden = row.id === "" || `#${row.id}` !== location.hash;
    for (const row of kept.slice(0, shown).flat()) row.hidden = false;
    this.table.tBodies[0]?.append(...kept.flat());
    this.count.value = kept.length === this.groups.length ? "" : `${kept.length} of ${this.groups.length}`;
    this.more.hidden = kept.length <= most;
    this.more.textContent = this._get("all") ? `show the first ${most}` : `show all ${kept.length} rows`;
    this.tools.hidden = this.fields.size === 0 && !this.zoom;
    const wide = this.zoom || [...this.fields.keys()].some((key) => key !== "sort");
    this.tools.classList.toggle("narrow-only", !wide);
    this._showScales();
  }

  _fits(group) {
    for (const { key, index } of this.columns.filter((one) => one.choice)) {
      if (this._get(key) && choiceOf(group[0].cells[index]) !== this._get(key)) return false;
    }
    const text = group.map((row) => row.textContent).join(" ").toLowerCase();
    return this._get("find").toLowerCase().split(/\s+/).every((word) => text.includes(word));
  }

  /** Sorts by the column that the address names; rows without a value come last, equal rows keep their order. */
  _sorted(groups) {
    const order = this._get("sort");
    const column = this.columns.find(({ key, sorts }) => sorts && key === order.replace(/^-/, ""));
    for (const { head, sorts } of this.columns) if (sorts) head.removeAttribute("aria-sort");
    if (!column) return groups;
    const down = order.startsWith("-");
    column.head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const keyed = groups.map((group) => ({ group, value: valueOf(group[0].cells[column.index]) }));
    const empty = ({ value }) => value === null;
    keyed.sort((a, b) => empty(a) - empty(b) || (down ? compare(b.value, a.value) : compare(a.value, b.value)));
    return keyed.map(({ group }) => group);
  }

  /** Draws all dots and whiskers on the whole scale of their column, or on the part of it that has values. */
  _showScales() {
    if (!this.zoom) return;
    const zoomed = Boolean(this._get("zoom"));
    this.zoom.setAttribute("aria-pressed", String(zoomed));
    for (const { head, index } of this.columns) {
      const plots = this.groups.flat().flatMap((row) => [...(row.cells[index]?.querySelectorAll("[data-reach]") ?? [])]);
      if (!plots.length) continue;
      const [from, to] = zoomed ? extent(plots.flatMap(reachOf)) : [0, 1];
      for (const plot of plots) place(plot, (share) => `${((100 * (share - from)) / (to - from)).toFixed(2)}%`);
      const ends = head.querySelector("[data-ends]");
      if (ends) showEnds(ends, from, to);
    }
  }
}

function columnOf(head, index) {
  const unit = head.querySelector(".unit")?.textContent ?? "";
  const ends = head.querySelector(".scale-ends")?.textContent ?? "";
  const title = head.textContent.replace(ends, "").replace(unit, "").trim();
  const key = head.dataset.key ?? title.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "");
  return { head, index, title, key, sorts: !("plain" in head.dataset), choice: "choice" in head.dataset };
}

const textOf = (cell) => cell?.textContent.trim().replace(/\s+/g, " ") ?? "";

const choiceOf = (cell) => cell?.dataset.value ?? textOf(cell);

/** What a cell sorts by: a number, a text, or null. */
function valueOf(cell) {
  const text = cell?.dataset.value ?? textOf(cell);
  if (text === "" || text === "—") return null;
  return Number.isFinite(Number(text)) ? Number(text) : text;
}

function compare(a, b) {
  if (typeof a === "number" && typeof b === "number") return a - b;
  return String(a).localeCompare(String(b), "en", { numeric: true });
}

/** Mean and ends of a plot, each as a share of its axis. */
const reachOf = (plot) => plot.dataset.reach.split(" ").map(Number);

/** The part of the axis that has values, with some room on both sides. */
function extent(shares) {
  const [low, high] = [Math.min(...shares), Math.max(...shares)];
  const room = Math.max(0.05 * (high - low), 0.005);
  return [low - room, high + room];
}

function place(plot, at) {
  const [mean, low, high] = reachOf(plot);
  plot.querySelector("circle").setAttribute("cx", at(mean));
  const reach = plot.querySelector(".reach");
  if (reach) for (const [name, share] of [["x1", low], ["x2", high]]) reach.setAttribute(name, at(share));
  const zero = plot.querySelector(".zero");
  if (!zero) return;
  zero.style.visibility = parseFloat(at(0.5)) >= 0 && parseFloat(at(0.5)) <= 100 ? "visible" : "hidden";
  for (const name of ["x1", "x2"]) zero.setAttribute(name, at(0.5));
}

function showEnds(ends, from, to) {
  const [bottom, top] = ends.dataset.ends.split(" ").map(Number);
  [from, to].forEach((share, i) => {
    ends.children[i].textContent = String(Number((bottom + share * (top - bottom)).toPrecision(3)));
  });
}

function make(name, attributes = {}, text = "") {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = text;
  return element;
}

function choice(title, options) {
  const label = make("label", {}, title);
  const element = make("select", { "aria-label": title });
  element.append(...options.map(([value, text]) => make("option", { value }, text)));
  label.append(element);
  return { label, element };
}

const readAddress = () => new URLSearchParams(location.search);

/** Writes one parameter into the address; a page in a frame or a file may refuse that, and works without. */
function writeAddress(key, value) {
  const url = new URL(location.href);
  if (value) url.searchParams.set(key, value);
  else url.searchParams.delete(key);
  try {
    history.replaceState(history.state, "", url);
  } catch (error) {
    console.info(error);
  }
}
