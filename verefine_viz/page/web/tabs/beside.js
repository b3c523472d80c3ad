// Starting a run beside another: both are computed to their ends, one after the other.
import { listen, send, state } from "../store.js";

let queue = null; // { was: what was compared before, asked: branch that is computed, began }

const isOver = (index) => state.runs.get(index)?.over ?? false;

// what: changed settings, { b } or { recording }.
export function runBeside(a, changes) {
  start({ verb: "compare", a, changes });
}
export function putBeside(a, what) {
  start({ verb: "compare", a, ...what });
}

function start(verb) {
  queue = { was: state.compare, asked: null, began: false };
  send({ ...verb, run: false });
}

export function runBoth() {
  queue = { was: null, asked: null, began: false };
  next();
}

function next() {
  if (!queue || !state.compare || state.compare === queue.was) return;
  const { branch } = state.running;
  if (queue.asked != null && !isOver(queue.asked)) {
    if (branch === queue.asked) queue.began = true;
    else if (branch == null && queue.began) queue = null; // it was paused
    return;
  }
  if (branch != null) return;
  const asked = [state.compare.a, state.compare.b].find((index) => !isOver(index));
  if (asked == null) queue = null;
  else {
    queue = { ...queue, asked, began: false };
    send({ verb: "run", branch: asked });
  }
}
listen(next);
