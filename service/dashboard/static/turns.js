/** Reads that overlap may end out of order; the answer of the last one begun is the one to show. */

/** Returns a function that begins a turn, which returns a function that says whether no later turn has begun. */
export function turns() {
  let last = 0;
  return () => {
    const own = ++last;
    return () => own === last;
  };
}
