// The cursor: actions that move it through a run, and what it does when rows come.
import { state, setView, update, send } from "./store.js";
import { runOf } from "./moment.js";

// Within known rows, actions only change the view; at the end they request more rows, and the cursor follows.

const ofIteration = { stage: null, moment: null, arm: null, edited: null };
let stageNext = false; // whether the next row is shown stage by stage
/** @type {number | null} */
let target = null; // the iteration that a link names, until its rows have come
let pinned = false; // whether a link's iteration is shown, so that new rows do not move the view
let timer = null;

const isKnown = () => state.runs.has(state.view.branch);
const known = () => runOf(state).rows.length;
const atEnd = () => state.view.k >= known();
const computes = () => state.running.branch != null;

/** @param {number} k */
export function seek(k) {
  stopReplay();
  const to = Math.max(0, Math.round(k));
  if (to > known()) {
    setView({ k: known(), ...ofIteration });
    if (!runOf(state).over) send({ verb: "seek", branch: state.view.branch, k: to });
  } else if (to !== state.view.k || state.view.stage || state.view.moment != null) setView({ k: to, ...ofIteration });
}

export function step() {
  if (!isKnown()) return undefined;
  stopReplay();
  if (state.view.stage) return setView({ stage: null, moment: null });
  if (!atEnd()) return setView({ k: state.view.k + 1, ...ofIteration });
  if (!runOf(state).over && !computes()) send({ verb: "step", branch: state.view.branch });
  return undefined;
}

export function stepStage() {
  if (!isKnown()) return undefined;
  stopReplay();
  const { k, stage } = state.view;
  /** @type {string[]} */
  const names = (runOf(state).rows[k - 1]?.stages ?? []).map((one) => one.name);
  const next = names[names.indexOf(stage) + 1];
  if (stage && next) return setView({ stage: next, moment: null });
  if (!atEnd()) {
    const row = runOf(state).rows[k];
    return setView({ k: k + 1, ...ofIteration, stage: row.stages[0].name });
  }
  if (runOf(state).over) return setView({ stage: null });
  stageNext = true;
  if (!computes()) send({ verb: "step", branch: state.view.branch });
  return undefined;
}

export function back() {
  stopReplay();
  const { k, stage } = state.view;
  /** @type {string[]} */
  const names = (runOf(state).rows[k - 1]?.stages ?? []).map((one) => one.name);
  const at = names.indexOf(stage);
  if (at > 0) return setView({ stage: names[at - 1], moment: null });
  if (k > 0) setView({ k: k - 1, ...ofIteration });
}

/** @param {"end" | "event"} until */
export function run(until = "end") {
  if (!isKnown()) return undefined;
  stopReplay();
  const r = runOf(state);
  if (r.over) return replay();
  setView({ k: known(), ...ofIteration });
  send({ verb: "run", branch: state.view.branch, until });
  return undefined;
}

export function pause() {
  stopReplay();
  if (computes()) send({ verb: "pause" });
}

export const isBusy = () => computes() || state.replaying;
export const toggleRun = () => (isBusy() ? pause() : run());

// Marks to stop at: every mark but a plain new best, of the object in focus where one was chosen.
/** @param {import("./store.js").State} s */
export function eventsOf(s) {
  const { obj } = s.view;
  return runOf(s).marks.filter((m) => m.tone !== "best" && (obj == null || m.obj === obj)).map((m) => m.k);
}

export function toNextEvent(direction = 1) {
  const ks = eventsOf(state);
  const { k } = state.view;
  const to = direction > 0 ? ks.find((x) => x > k) : ks.findLast((x) => x < k);
  if (to != null) return seek(to);
  if (direction > 0 && !runOf(state).over) return run("event");
  seek(direction > 0 ? known() : 0);
}

// Shows iteration k, now or once its rows have come.
/** @param {number} k */
export function goTo(k) {
  stopReplay();
  target = k > known() ? k : null;
  pinned = target == null;
  setView({ k: Math.min(k, known()) });
}

// Plays the known rows, `state.speed` iterations per second.
export function replay() {
  stopReplay();
  if (!known()) return;
  if (atEnd()) setView({ k: 0, ...ofIteration });
  const tick = () => {
    if (atEnd()) return stopReplay();
    setView({ k: state.view.k + 1, ...ofIteration });
    timer = setTimeout(tick, 1000 / state.speed);
  };
  timer = setTimeout(tick, 1000 / state.speed);
  update({ replaying: true });
}

export function stopReplay() {
  clearTimeout(timer);
  target = null;
  pinned = false;
  if (state.replaying) update({ replaying: false });
}

// Rows came: a view at the end stays at the end, unless a pose is edited.
/** @type {(wasAtEnd: boolean, branch: number) => void} */
export function followed(wasAtEnd, branch) {
  if (branch !== state.view.branch) return;
  const k = Math.min(known(), target ?? Infinity);
  if (target != null) {
    pinned = k === target;
    if (pinned) target = null;
  } else if ((pinned || !wasAtEnd) && state.view.k <= known()) return;
  const stage = stageNext && k > 0 ? runOf(state).rows[k - 1].stages[0].name : null;
  stageNext = stageNext && k === 0;
  if (state.view.edited) return; // an edited pose stays in view
  setView({ k, moment: null, arm: null, stage, edited: null });
}
