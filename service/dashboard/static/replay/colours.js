/** The colours of the stylesheet, for canvases. */

const TOKENS = {
  page: "--page",
  ink: "--ink",
  accent: "--accent",
  lane: "--lane",
  edge: "--lane-edge",
  walk: "--walk",
  stripe: "--stripe",
  actor: "--actor",
  notch: "--notch",
  person: "--person",
  infraction: "--infraction",
  warning: "--warning",
  success: "--success",
};

/** Colours by name in the current scheme, light or dark. */
export function readColours(element) {
  const style = getComputedStyle(element);
  return Object.fromEntries(
    Object.entries(TOKENS).map(([name, token]) => [name, style.getPropertyValue(token).trim()]),
  );
}
