// Everything the page knows, once: what the server said, and what this window looks at.
import { useState, useEffect, useRef } from "./vendor/htm-preact.js";

export const state = {
  connection: "opening", // opening, open (all that the server knows has come), lost
  window: null,
  frame: null,
  branches: [],
  compare: null,
  runs: new Map(), // branch → { rows, total, over, marks }
  verdicts: new Map(), // branch → verdict
  answers: null, // the gallery
  busy: { text: "" },
  running: { branch: null },
  scene3d: null, // the window that the 3D view follows
  toasts: [],
  written: [],
  view: {
    branch: 0,
    k: 0,
    stage: null, // last stage of iteration k that is shown; null = all of it
    obj: null, // null = the object of the iteration
    arm: null,
    moment: null, // of the simulated path
    edited: null, // { obj, arm, T, from } while a pose is edited
    a: null, // stages that are compared; null = chosen by itself
    b: null,
    map: "classes",
    pixel: null, // [u, v]
    tab: "score",
    preset: "inspect",
    full: null, // the pane that fills the middle
  },
};

// Listeners are called at most once per animation frame, however much has changed.
const listeners = new Set();
let scheduled = false;
export function changed() {
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(() => {
    scheduled = false;
    for (const listener of [...listeners]) listener();
  });
}

export function listen(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

export function update(patch) {
  Object.assign(state, patch);
  changed();
}

export function setView(patch) {
  const before = state.view;
  state.view = { ...before, ...patch };
  changed();
}

const same = (a, b) =>
  Object.is(a, b) ||
  (Array.isArray(a) && Array.isArray(b) && a.length === b.length && a.every((x, i) => Object.is(x, b[i])));

// A component that calls it is drawn again when what `select` gives changes: a value, or an array of values.
export function useStore(select) {
  const [, redraw] = useState(0);
  const chosen = select(state);
  const last = useRef();
  last.current = { select, chosen };
  useEffect(() => {
    const check = () => {
      const { select, chosen } = last.current;
      if (!same(select(state), chosen)) redraw((n) => n + 1);
    };
    const stop = listen(check);
    check(); // what came between the drawing and now
    return stop;
  }, []);
  return chosen;
}

// Who answers: the program's server (connection.js), or the file that the page itself is (file.js).
// { send(verb) → whether it arrived, load(key) → promise of the bytes of a blob or null, address(path) }
let server = null;
const handlers = {};
export function on(t, handler) {
  handlers[t] = handler;
}
export function answeredBy(one) {
  server = one;
}

export const send = (verb) => server.send(verb);
export const addressOf = (path) => server.address(path);

export function receive(message) {
  handlers[message.t]?.(message);
  changed();
}

// Answers of the server to what views ask for, the latest used last.

const MOST_ANSWERS = 400;
const known = new Map(); // what is asked, as JSON → { id, slot, answer }
const asked = new Map(); // slot → what was asked for last, as JSON
const waiting = new Map(); // id → what it asks for, as JSON: ids are short, poses are not
const keys = new WeakMap(); // what is asked → as JSON
let wants = 0;

on("answer", (message) => {
  const key = waiting.get(message.id) ?? message.id; // of `evaluate` the id itself
  waiting.delete(message.id);
  known.set(key, { ...known.get(key), answer: message });
});

export function forgetAnswers() {
  known.clear();
  asked.clear();
  waiting.clear();
}

// The answer to a want, or undefined; asked for once. `slot`: of the wants of one slot the server answers the latest.
export function want(of, slot = "") {
  if (!keys.has(of)) keys.set(of, JSON.stringify(of));
  const key = keys.get(of);
  let entry = known.get(key);
  if (!entry || (!entry.answer && entry.slot && asked.get(entry.slot) !== key)) {
    entry = { id: entry?.id ?? `want ${++wants}`, slot };
    if (!send({ verb: "want", id: entry.id, slot, of })) return undefined;
    asked.set(slot, key);
    waiting.set(entry.id, key);
  }
  known.delete(key);
  known.set(key, entry); // used last
  if (known.size > MOST_ANSWERS) {
    const [dropped, { id }] = known.entries().next().value;
    known.delete(dropped);
    waiting.delete(id);
  }
  return entry.answer;
}

// An answer that was asked for by another verb than `want`, or undefined.
export const answerTo = (id) => known.get(id)?.answer;

export function useWant(of, slot = "") {
  return useStore(() => (of ? want(of, slot) : undefined));
}

// The server no longer has what an answer names: it is asked for again when it is next needed.
export function forget(answer) {
  for (const [key, entry] of known) if (entry.answer === answer) known.delete(key);
}

// Binary arrays that messages name.

const MOST_BLOBS = 60;
const blobs = new Map(); // key → { buffer, isGone }
export function blob(key) {
  let entry = blobs.get(key);
  if (!entry) {
    entry = { buffer: null, isGone: false };
    blobs.set(key, entry);
    server.load(key)
      .then((buffer) => {
        Object.assign(entry, { buffer, isGone: !buffer });
        changed();
      })
      .catch(() => blobs.delete(key));
    if (blobs.size > MOST_BLOBS) blobs.delete(blobs.keys().next().value);
  } else {
    blobs.delete(key);
    blobs.set(key, entry);
  }
  return entry.buffer;
}

const TYPES = {
  float32: Float32Array, uint8: Uint8Array, int32: Int32Array, uint16: Uint16Array, int16: Int16Array,
  float64: Float64Array,
};
const NO_VALUE = { uint8: 255, uint16: 65535, int16: 32767 }; // among whole numbers of a step
const unpacked = new WeakMap(); // buffer → arrays by name: they go when the blob does
// The arrays of an answer by name, or null until they are there.
export function arraysOf(answer) {
  const buffer = answer?.blob ? blob(answer.blob) : null;
  if (!buffer) {
    if (blobs.get(answer?.blob)?.isGone) forget(answer);
    return null;
  }
  if (!unpacked.has(buffer)) {
    const arrays = {};
    for (const [name, type, offset, length, step] of answer.arrays) {
      const values = new TYPES[type](buffer, offset, length);
      arrays[name] = step ? Float32Array.from(values, (x) => (x === NO_VALUE[type] ? NaN : x * step)) : values;
    }
    unpacked.set(buffer, arrays);
  }
  return unpacked.get(buffer);
}
