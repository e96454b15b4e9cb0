/** The notice of a page that keeps itself up to date, while it cannot. */

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

function why(error) {
  if (!(error instanceof ApiError)) return "The connection to the service is lost, and tried again.";
  return `The service refused: ${[error.status, error.message].filter(Boolean).join(", ")}. It is asked again.`;
}
