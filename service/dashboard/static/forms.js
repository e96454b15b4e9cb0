/** Forms that send a change to the service, with each fault beside its field. */

import { ApiError, send } from "./api.js";
import { h } from "./dom.js";
import { copyText } from "./table.js";

let made = 0;

/** A labelled field; `hint` says what is expected. */
export function field(title, name, input, hint = "") {
  const id = `field-${++made}`;
  const about = [hint && `${id}-hint`, `${id}-fault`].filter(Boolean).join(" ");
  input.id = id;
  input.name = name;
  input.setAttribute("aria-describedby", about);
  const fault = h("p", { class: "problem", id: `${id}-fault`, hidden: true });
  return h(
    "div",
    { class: "field", "data-field": name },
    h("label", { for: id }, title),
    input,
    hint && h("p", { class: "note", id: `${id}-hint` }, hint),
    fault,
  );
}

export const input = (type, attributes = {}) => h("input", { type, ...attributes });

export const select = (options, chosen) =>
  h("select", {}, options.map(([value, text]) => h("option", { value, selected: value === chosen }, text)));

/**
 * A form. A fault of the answer stands beside the field that it names, any other above the button.
 * @param {Node[]} fields
 * @param {string} action text of the button
 * @param {(values: FormData) => Promise<void>} act
 * @param {string} [otherwise] the field of refusals that name none, such as those of an uploaded file
 */
export function form(fields, action, act, otherwise = "") {
  const button = h("button", { type: "submit", class: "primary" }, action);
  const said = h("p", { class: "problem", role: "alert", hidden: true });
  const element = h("form", { class: "fields" }, fields, said, h("p", {}, button));
  element.addEventListener("submit", async (event) => {
    event.preventDefault();
    clear(element, said);
    button.disabled = true;
    button.textContent = `${action} …`;
    try {
      await act(new FormData(element));
    } catch (error) {
      if (!(error instanceof ApiError)) console.warn(error);
      show(element, said, error, otherwise);
    }
    button.disabled = false;
    button.textContent = action;
  });
  return element;
}

function clear(element, said) {
  said.hidden = true;
  for (const fault of element.querySelectorAll(".field > .problem")) fault.hidden = true;
  for (const one of element.querySelectorAll("[aria-invalid]")) one.removeAttribute("aria-invalid");
}

function show(element, said, error, otherwise) {
  const faults = error.faults?.length ? error.faults : [placeOf(error.message)];
  const named = (name) => element.querySelector(`[data-field="${CSS.escape(name)}"]:not([hidden])`);
  let first = null;
  for (const { where, expected } of faults) {
    const parts = where.split(/[.:]/).map((part) => part.trim());
    const place = parts.reverse().map(named).find(Boolean) ?? (error.status === 422 ? named(otherwise) : null);
    if (place) {
      mark(place, expected);
      first ??= place;
    } else {
      said.textContent = `✕ ${where && error.faults?.length ? `${where}: ` : ""}${expected}`;
      said.hidden = false;
    }
  }
  first?.querySelector("input, select, textarea").focus();
}

function mark(place, text) {
  const fault = place.querySelector(".problem");
  fault.textContent = `✕ ${text}`;
  fault.hidden = false;
  place.querySelector("input, select, textarea").setAttribute("aria-invalid", "true");
}

/** The places that a message begins with, such as `spec: control: expected ...`. */
function placeOf(message) {
  const [, where = "", expected = message] = /^((?:[a-z0-9_.]+: )+)(.*)$/s.exec(message) ?? [];
  return { where: where ? where.replace(/: $/, "").replaceAll(": ", ".") : "", expected: where ? message : expected };
}

/** A button that sends a change at once; a second press within some seconds confirms it. */
export function confirmed(text, sure, method, path, after) {
  const button = h("button", { type: "button", class: "small-button" }, text);
  button.addEventListener("click", async () => {
    if (button.dataset.asked !== "yes") {
      button.dataset.asked = "yes";
      button.textContent = sure;
      setTimeout(() => ((button.dataset.asked = "no"), (button.textContent = text)), 4000);
      return;
    }
    button.disabled = true;
    try {
      await send(method, path);
      await after();
    } catch (error) {
      button.replaceWith(h("span", { class: "problem", role: "alert" }, error.message));
    }
  });
  return button;
}

/** A secret that is shown once, with a button that copies it. */
export function shownOnce(title, secret, note) {
  const button = h("button", { type: "button", class: "copy" }, "copy");
  button.addEventListener("click", async () => {
    await copyText(secret);
    button.textContent = "copied";
  });
  return h(
    "div",
    { class: "panel once", role: "status" },
    h("h3", {}, title),
    h("div", { class: "example" }, button, h("pre", { tabindex: 0 }, h("code", { class: "secret" }, secret))),
    h("p", { class: "note" }, note),
  );
}
