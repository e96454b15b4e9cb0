/** The part of the address after #: time, ego and camera, so that a copied link shows the same view. */

const WRITE_MS = 400; // browsers refuse more than some hundred changes in half a minute

/** @returns {{t: number|null, ego: string|null, x: number|null, y: number|null, z: number|null}} */
export function readAddress(hash = location.hash) {
  const given = new URLSearchParams(hash.slice(1));
  const value = (name) => {
    const text = given.get(name);
    return text !== null && text !== "" && Number.isFinite(Number(text)) ? Number(text) : null;
  };
  return { t: value("t"), ego: given.get("ego"), x: value("x"), y: value("y"), z: value("z") };
}

/** The address of a moment; a camera that follows its ego needs no position. */
export function address(clock, camera, ego) {
  const parts = [`t=${clock.time.toFixed(1)}`];
  if (ego) parts.push(`ego=${encodeURIComponent(ego)}`);
  if (!camera.follow) parts.push(`x=${camera.x.toFixed(1)}`, `y=${camera.y.toFixed(1)}`);
  parts.push(`z=${camera.scale.toFixed(2)}`);
  return `#${parts.join("&")}`;
}

/** Returns a function that writes the address, at most once per WRITE_MS, until the signal stops it. */
export function writer(make, signal) {
  let timer = 0;
  return () => {
    if (timer) return;
    timer = setTimeout(() => {
      timer = 0;
      if (signal?.aborted) return;
      history.replaceState(history.state, "", make());
    }, WRITE_MS);
  };
}
