/** Rules and other texts of organisers: a small part of Markdown, made into elements. No markup of theirs is parsed. */

import { h } from "./dom.js";

/** Headings (#), lists (- or 1.), paragraphs, `code`, **bold** and links to http(s) addresses. */
export function prose(text) {
  const blocks = text.replaceAll("\r\n", "\n").split(/\n{2,}/).flatMap(splitHeading);
  return h("div", { class: "prose" }, blocks.filter((block) => block.trim()).map(block));
}

/** A heading ends its block, also without an empty line after it. */
function splitHeading(text) {
  const [first, ...rest] = text.split("\n");
  return /^#{1,4} /.test(first) && rest.length ? [first, rest.join("\n")] : [text];
}

function block(text) {
  const heading = /^#{1,4} (.*)$/.exec(text.trim());
  if (heading) return h("h3", {}, inline(heading[1]));
  const lines = text.trim().split("\n");
  for (const [pattern, name] of [[/^[-*] /, "ul"], [/^\d+\. /, "ol"]]) {
    if (lines.every((line) => pattern.test(line)))
      return h(name, {}, lines.map((line) => h("li", {}, inline(line.replace(pattern, "")))));
  }
  return h("p", {}, inline(lines.join(" ")));
}

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
