/** Rules and other texts of organisers: a small part of Markdown, made into elements. No markup of theirs is parsed. */

import { h } from "./dom.js";

const FENCE = /^ {0,3}```/;
const HEADING = /^ {0,3}#{1,6} +(.*)$/;
const LISTS = [[/^\s*[-*] +/, "ul"], [/^\s*\d{1,9}\. +/, "ol"]];
const FIRST = /^\s*([-*]|1\.) /; // begins a list after a line of text, which may hold a wrapped "2026. "

/**
 * Headings (#), lists (- or 1.) whose items may go on in indented lines, fenced code (```), paragraphs, `code`, **bold**
 * and links to http(s) addresses. Anything else, such as a table, is text.
 */
export function prose(text) {
  const lines = text.replaceAll("\r\n", "\n").split("\n");
  const blocks = [];
  while (lines.length) {
    if (!lines[0].trim()) lines.shift();
    else blocks.push(fenced(lines) ?? heading(lines) ?? list(lines) ?? paragraph(lines));
  }
  return h("div", { class: "prose" }, blocks);
}

// Each of these takes the lines of one block from the beginning of the list, or none where it begins with another.

/** Lines between two fences; without a second one, all that follow. */
function fenced(lines) {
  if (!FENCE.test(lines[0])) return null;
  const end = lines.findIndex((line, i) => i > 0 && FENCE.test(line));
  const [, ...code] = lines.splice(0, end < 0 ? lines.length : end + 1);
  if (end > 0) code.pop();
  return h("pre", { tabindex: 0 }, h("code", {}, code.join("\n")));
}

function heading(lines) {
  const found = HEADING.exec(lines[0]);
  if (!found) return null;
  lines.shift();
  return h("h3", {}, inline(found[1]));
}

/** Items of one kind; an indented line goes on with the item above it. */
function list(lines) {
  const [pattern, name] = LISTS.find(([one]) => one.test(lines[0])) ?? [];
  if (!name) return null;
  const first = name === "ol" ? parseInt(lines[0], 10) : 1;
  const items = [];
  while (lines.length && lines[0].trim()) {
    if (pattern.test(lines[0])) items.push(lines.shift().replace(pattern, ""));
    else if (/^\s/.test(lines[0]) && !begins(lines[0])) items.push(`${items.pop()} ${lines.shift().trim()}`);
    else break;
  }
  return h(name, { start: first === 1 ? null : first }, items.map((item) => h("li", {}, inline(item))));
}

function paragraph(lines) {
  const own = [];
  do own.push(lines.shift().trim());
  while (lines.length && lines[0].trim() && !(FIRST.test(lines[0]) || FENCE.test(lines[0]) || HEADING.test(lines[0])));
  return h("p", {}, inline(own.join(" ")));
}

/** Whether a block other than a paragraph begins with a line. */
const begins = (line) => FENCE.test(line) || HEADING.test(line) || LISTS.some(([one]) => one.test(line));

const INLINE = /`([^`]+)`|\*\*([^*]+)\*\*|\[([^\]]+)\]\((https?:\/\/[^\s)]+)\)/g;

function inline(text) {
  const parts = [];
  let end = 0;
  for (const found of text.matchAll(INLINE)) {
    const [whole, code, bold, name, address] = found;
    parts.push(text.slice(end, found.index));
    if (code) parts.push(h("code", {}, code));
    else if (bold) parts.push(h("b", {}, bold));
    else parts.push(h("a", { href: address, rel: "noopener noreferrer nofollow" }, name));
    end = found.index + whole.length;
  }
  return [...parts, text.slice(end)];
}
