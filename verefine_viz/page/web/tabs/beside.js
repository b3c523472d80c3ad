// Starting a run beside another: both are computed to their ends, one after the other.
import { listen, send, state, update } from "../store.js";

/** @import { Compare } from "../messages.d.ts" */

const isOver = (/** @type {number} */ index) => state.runs.get(index)?.over ?? false;

/** @type {(a: number, changes: Compare["changes"]) => void} */
export function runBeside(a, changes) {
  start({ verb: "compare", a, changes });
}
/**
 * @param {number} a
 * @param {Pick<Compare, "b" | "recording">} what
 */
export function putBeside(a, what) {
  start({ verb: "compare", a, ...what });
}

/** @param {Compare} verb */
function start(verb) {
  update({ finishing: { was: state.compare, asked: null, began: false } });
  send({ ...verb, run: false });
}

export function runBoth() {
  update({ finishing: { was: null, asked: null, began: false } });
}

function next() {
  const { finishing, compare, running: { branch } } = state;
  if (!finishing || !compare || compare === finishing.was) return;
  if (finishing.asked != null && !isOver(finishing.asked)) {
    if (branch === finishing.asked) finishing.began = true;
    else if (branch == null && finishing.began) update({ finishing: null }); // it was paused
    return;
  }
  if (branch != null) return;
  const asked = [compare.a, compare.b].find((index) => !isOver(index));
  if (asked == null) return update({ finishing: null });
  update({ finishing: { ...finishing, asked, began: false } });
  send({ verb: "run", branch: asked });
}
listen(next);
