/** Notices: of a page that keeps itself up to date, while it cannot; of a section whose request failed. */

import { ApiError } from "./api.js";
import { h } from "./dom.js";

/**
 * A notice that is hidden until there is something to tell.
 * @returns {{element: HTMLElement, tell: (error?: Error) => void, clear: () => void}}
 */
export function staleNotice() {
  const element = h("p", { class: "problem", role: "alert", hidden: true });
  return {
    element,
    tell(error) {
      element.textContent = `${why(error)} What is shown may be old.`;
      element.hidden = false;
    },
    clear() {
      element.hidden = true;
    },
  };
}

/**
 * What a section shows whose request failed: why, and a button that loads the page again unless that may not be read.
 * @param {string | null} title its heading; null where the heading stands already
 * @param {Error} error
 */
export function unread(title, error) {
  const said = [error.status, error.message].filter(Boolean).join(", ");
  const again = () => h("p", {}, h("button", { type: "button", click: () => location.reload() }, "load again"));
  return [
    title && h("h2", {}, title),
    h("p", { class: "problem", role: "alert" }, `This could not be read: ${said || "the service did not answer"}`),
    error.status !== 403 && again(),
  ];
}

function why(error) {
  if (!(error instanceof ApiError)) return "The connection to the service is lost, and tried again.";
  return `The service refused: ${[error.status, error.message].filter(Boolean).join(", ")}. It is asked again.`;
}
