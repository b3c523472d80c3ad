// What stands where at the cursor, worked out from the rows of the run; and the actions that move the cursor.
import { state, setView, update, send } from "./store.js";

// Colours that mean something are the same in pictures, maps, reports and here: core/palette.py.
export const STAGE_COLORS = {
  initial: "#8a8a8a", current: "#a0a0a0", simulated: "#ff8c00", mixed: "#f0d228", refined: "#326eff",
    flipped: "#eb3cc8",
  accepted: "#28c850", best: "#00aa78", "runner-up": "#ff69b4", edited: "#be5adc", "ground truth": "#ffffff",
};
export const STAGE_MEANINGS = {
  initial: "where the hypothesis started",
  current: "where this iteration started",
  simulated: "after physics",
  mixed: "rotation of simulated, translation of current: where the refiner starts",
  refined: "after the refiner",
  flipped: "turned to where the shape looks nearly the same",
  accepted: "the pose that the next iteration of this hypothesis starts from",
  best: "the best pose of the object so far; the answer of a finished run",
  "runner-up": "the best pose of another hypothesis than the answer's",
  edited: "the pose that is edited",
  "ground truth": "the true pose",
};
export const TONES = {
  problem: { words: "problem", color: "#dc322f", shape: "down" },
  rejected: { words: "simulated accepted", color: "#ff8c00", shape: "square" },
  flip: { words: "flip", color: "#eb3cc8", shape: "cross" },
  edited: { words: "edited pose", color: "#be5adc", shape: "circle" },
  switched: { words: "hypothesis switched", color: "#326eff", shape: "bar" },
  best: { words: "new best", color: "#28a860", shape: "up" },
};
const NO_RUN = { rows: [], marks: [], notes: [], total: 0, over: false, start: null };
const NEAR = 0.005; // a smaller difference of score is a tie

export const runOf = (s, branch = s.view.branch) => s.runs.get(branch) ?? NO_RUN;

// Answers that depend on the same inputs are the same object: of each function the last few stay.
function memoized(inputs, work, keep = 4) {
  const recent = [];
  return (...args) => {
    const key = inputs(...args);
    const known = recent.find((entry) => entry.key.every((x, i) => x === key[i]));
    if (known) return known.value;
    const value = work(...args);
    recent.unshift({ key, value });
    recent.length = Math.min(recent.length, keep);
    return value;
  };
}

export const samePose = (a, b) => a === b || (a != null && b != null && a.every((x, i) => x === b[i]));

// By object, its rows in their order; appended rows make another run object, so identity is enough.
const rowsByObject = memoized(
  (run) => [run],
  (run) => {
    const own = new Map();
    for (const row of run.rows) own.has(row.obj) ? own.get(row.obj).push(row) : own.set(row.obj, [row]);
    return own;
  },
  6,
);
export const rowsOf = (run, obj) => rowsByObject(run).get(obj) ?? [];

// The latest of `rows` with row.k ≤ k, or undefined.
export function latest(rows, k) {
  let low = 0;
  let high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle].k <= k) low = middle + 1;
    else high = middle;
  }
  return rows[low - 1];
}

export const startsOf = (run, object) => run.start?.[object.id] ?? object.arms;

// Where a hypothesis comes from; "" where all come from the same.
export function sourceOf({ starts }, arm) {
  const stem = (a) => (a.source ?? "").replace(/ #\d+$/, "");
  return starts[arm] && new Set(starts.map(stem)).size > 1 ? stem(starts[arm]) : "";
}

function bestStart(run, object) {
  let arm = -1;
  startsOf(run, object).forEach((a, j, all) => {
    if (arm < 0 || (a.score ?? 0) > (all[arm].score ?? 0)) arm = j;
  });
  if (arm < 0) return null;
  const { T, score, err } = startsOf(run, object)[arm];
  return { T, score, err, arm, k: 0, stage: "initial" };
}

// An object's best after iteration k; of a finished run its answer, which methods that keep the best scene take from
// that.
function bestAt(run, object, k, outcome) {
  if (outcome?.T) {
    const { T, score, err, deg, mm, arm, k: made, stage } = outcome;
    return { T, score, err, deg, mm, arm, k: made, stage };
  }
  const row = latest(rowsOf(run, object.id), k);
  return row ? row.best : bestStart(run, object);
}

// Every object of the frame at iteration k: { object, phase, best, T, score, err, spent, verdict }.
function sceneAt(s, run, k, at, shown, isAnswer, verdict) {
  const row = isAnswer ? null : at;
  const stands = new Map([...(row?.placed ?? []), ...(row?.tree?.rollout ?? [])].map((p) => [p.obj, p.T]));
  const placed = new Set((row?.placed ?? []).map((p) => p.obj));
  return s.frame.objects.map((object) => {
    const outcome = isAnswer ? verdict?.objects.find((o) => o.obj === object.id) : null;
    const best = bestAt(run, object, k, outcome);
    const own = latest(rowsOf(run, object.id), k);
    let phase = "waiting";
    if (!best) phase = "no pose";
    else if (isAnswer) phase = "done";
    else if (row?.obj === object.id) phase = "working";
    else if (placed.has(object.id)) phase = "placed";
    else if (stands.has(object.id)) phase = "rolled out";
    else if (own && !(row.pass || row.tree) && rowsOf(run, object.id).at(-1).k <= k) phase = "done";
    else if (own) phase = "paused";
    const T = row?.obj === object.id ? shown : stands.get(object.id) ?? best?.T ?? null;
    return { object, phase, best, T, score: best?.score ?? null, err: best?.err ?? null, spent: own?.own ?? 0,
      verdict: outcome ?? null };
  });
}

// Which hypothesis was edited, and how far.
export function editWords({ obj, arm, mm, deg }, objects) {
  const of = objects.length > 1 ? ` of ${objects.find((o) => o.id === obj)?.label ?? `object ${obj}`}` : "";
  const far = mm == null ? "" : `, ${mm.toFixed(1)} mm and ${deg.toFixed(1)}° from its initial pose`;
  return `Hypothesis ${arm + 1}${of} edited${far}`;
}

export const verdictOf = (s, obj, branch = s.view.branch) =>
  s.verdicts.get(branch)?.objects.find((o) => o.obj === obj) ?? null;

// The object that a finished run names first: wrong before doubtful, the farthest from its limit first.
export function worstOf(verdict) {
  const rank = { wrong: 0, none: 1, doubt: 2, unknown: 3, right: 4 };
  const excess = (o) => (o.err != null && o.limit ? o.err / o.limit : 1 - (o.score ?? 0));
  return [...(verdict?.objects ?? [])].sort((a, b) => rank[a.tone] - rank[b.tone] || excess(b) - excess(a))[0] ?? null;
}

// Everything about (branch, k, stage, obj) of the view, or null before a frame is open.
export const momentOf = memoized(
  (s) => [s.frame, s.branches, s.runs.get(s.view.branch), s.verdicts.get(s.view.branch), s.view, s.compare,
    s.compare && s.runs.get(other(s))],
  (s) => {
    const moment = momentAt(s, s.view);
    if (!moment) return null;
    const isCompared = s.compare && [s.compare.a, s.compare.b].includes(s.view.branch);
    const beside = isCompared && s.view.branch !== other(s) ? momentBeside(s, moment) : null;
    return { ...moment, beside, ...pairOf(s, moment, beside) };
  },
);

const other = (s) => (s.view.branch === s.compare.b ? s.compare.a : s.compare.b);

function momentBeside(s, moment) {
  const run = s.runs.get(other(s));
  if (!run) return null;
  const k = moment.isAnswer ? run.rows.length : Math.min(s.view.beside ?? moment.k, run.rows.length);
  return momentAt(s, { ...s.view, branch: other(s), k, stage: null, edited: null, moment: null, obj: moment.obj });
}

function momentAt(s, view) {
  if (!s.frame) return null;
  const run = runOf(s, view.branch);
  const k = Math.min(view.k, run.rows.length);
  const at = run.rows[k - 1];
  const isAnswer = run.over && k > 0 && k === run.rows.length && view.stage == null && view.moment == null
    && !view.edited;
  const verdict = s.verdicts.get(view.branch);
  const first = s.frame.objects.find((o) => startsOf(run, o).length) ?? s.frame.objects[0];
  const obj = view.obj ?? (isAnswer ? verdict?.scene?.worst ?? worstOf(verdict)?.obj : null) ?? at?.obj ?? first?.id
    ?? null;
  const object = s.frame.objects.find((o) => o.id === obj) ?? first;
  if (!object) return null;
  const own = rowsOf(run, object.id);
  const row = latest(own, k) ?? null; // the latest iteration that worked on the object
  const isCurrent = row != null && row.k === k;
  const names = row ? row.stages.map((stage) => stage.name) : [];
  const cut = isCurrent && names.includes(view.stage) ? names.indexOf(view.stage) + 1 : names.length;
  const isPartial = cut < names.length;
  const before = isPartial ? latest(own, row.k - 1) : row; // whose results are known by now
  const starts = startsOf(run, object);
  const outcome = verdict?.objects.find((o) => o.obj === object.id) ?? null;
  const best = bestAt(run, object, before?.k ?? 0, isAnswer ? outcome : null);
  const arms = before
    ? before.arms
    : starts.map((a) => ({ plays: a.plays ?? 0, mean: a.mean ?? a.score, score: a.score, err: a.err, T: a.T }));
  // The pose that the branch goes on from, where it was edited after this iteration.
  const moved = isAnswer || isPartial || view.edited ? null
    : s.branches.find((b) => b.index === view.branch)?.edits.find((e) => e.k === k && e.obj === object.id);
  const arm = Math.min(view.arm ?? (isAnswer ? best?.arm : row?.arm ?? best?.arm) ?? 0, Math.max(arms.length - 1, 0));

  const poses = {};
  if (starts[arm]) poses.initial = { ...starts[arm], arm };
  if (!isAnswer && row) {
    for (const stage of row.stages.slice(0, cut)) poses[stage.name] = { ...stage, arm: row.arm };
    if (!isPartial) poses.accepted = { ...row.stages.find((stage) => stage.name === row.accepted), arm: row.arm };
  } else if (!isAnswer && arms[arm]) poses.current = { ...arms[arm], arm };
  if (best) poses.best = { ...best };
  if (isAnswer && outcome?.runner_up) {
    const { T, arm: j, lead } = outcome.runner_up;
    poses["runner-up"] = { T, arm: j, score: outcome.score - lead, err: outcome.runner_up.err ?? null };
  }
  if (view.edited && view.edited.obj === object.id) poses.edited = { T: view.edited.T, arm: view.edited.arm };
  else if (moved) {
    const one = arms[moved.arm];
    poses.edited = { ...(samePose(one?.T, moved.T) ? one : {}), T: moved.T, arm: moved.arm };
  }
  if (object.gt) poses["ground truth"] = { T: object.gt, err: 0, score: object.gt_score ?? null };
  for (const [name, pose] of Object.entries(poses)) pose.stage = name;

  const stands = isPartial ? row.stages[cut - 1].T : row ? (poses.edited ?? poses.accepted ?? poses.best).T : best?.T;
  return {
    branch: view.branch, run, k, total: run.total, over: run.over, at: at ?? null, row, isCurrent, isAnswer, isPartial,
    obj: object.id, object, starts, arm, arms, best, poses, stages: names,
    stage: isPartial ? view.stage : null, verdict: outcome,
    scene: sceneAt(s, run, k, at, stands, isAnswer, verdict),
  };
}

// A and B: what the user chose, else the pair that shows most; the same pose twice only where there is no other.
function pairOf(s, moment, beside) {
  const { poses, isAnswer, verdict } = moment;
  const named = (name) => name && poses[name] && { name, label: labelOf(name, moment), ...poses[name] };
  if (beside && !s.view.edited) {
    const side = (m, letter) => {
      const name = m.isAnswer || !m.poses.accepted ? "best" : "accepted";
      const title = s.branches.find((b) => b.index === m.branch)?.name ?? "";
      const label = title.startsWith(`${letter}: `) ? title : `${letter}: ${title}`;
      return m.poses[name] && { name, ...m.poses[name], label, branch: m.branch, k: m.k };
    };
    const first = s.view.branch === s.compare.a;
    const [a, b] = first ? [side(moment, "A"), side(beside, "B")] : [side(beside, "A"), side(moment, "B")];
    if (a && b) return { a, b, same: samePose(a.T, b.T) };
  }
  const wrong = verdict ? verdict.tone === "wrong" : false;
  const pairs = [
    [s.view.a, s.view.b],
    poses.edited && ["accepted", "edited"],
    poses.edited && ["current", "edited"],
    poses.edited && ["best", "edited"],
    isAnswer && wrong && ["best", "ground truth"],
    isAnswer && !poses["ground truth"] && ["runner-up", "best"],
    isAnswer && ["initial", "best"],
    isAnswer && ["runner-up", "best"],
    isAnswer && ["best", "ground truth"],
    moment.row?.accepted === "flipped" && ["refined", "flipped"],
    ["simulated", "refined"],
    ["current", "refined"],
    ["current", "simulated"],
    ["current", "accepted"],
    ["initial", "accepted"],
    ["initial", "best"],
    ["best", "ground truth"],
    ["current", "ground truth"],
    ["initial", "ground truth"],
  ].filter((pair) => pair && pair[0] && pair[1] && poses[pair[0]] && poses[pair[1]]);
  const unlike = pairs.find(([a, b], i) => (i === 0 && a === s.view.a && b === s.view.b)
    || !samePose(poses[a].T, poses[b].T));
  const [a, b] = unlike ?? pairs[0] ?? [Object.keys(poses)[0], undefined];
  return { a: named(a) || null, b: named(b) || null, same: Boolean(a && b && samePose(poses[a]?.T, poses[b]?.T)) };
}

// Only methods that verify keep the best pose; others, and recorded steps, go on from their last one.
export function bestWords(branch) {
  const name = state.branches.find((b) => b.index === branch)?.settings["method.name"] ?? state.frame.method;
  return state.frame.choices.methods.find((m) => m.name === name)?.verifies ? "best so far" : "pose so far";
}
export const labelOf = (name, moment) => (name === "best" ? (moment.isAnswer ? "answer" : bestWords(moment.branch)) : name);

// Hypotheses are coloured by rank: from pale slate to strong violet, hues that no stage, tone or answer has.
const RAMP = { light: [[214, 20, 76], [262, 76, 44]], dark: [[216, 18, 36], [262, 95, 78]] };
export function rampColor(share, theme = document.documentElement.dataset.theme) {
  const [low, high] = RAMP[theme === "light" ? "light" : "dark"];
  const t = Math.max(0, Math.min(1, share));
  const [h, s, l] = low.map((x, i) => x + (high[i] - x) * t);
  return `hsl(${h.toFixed(0)} ${s.toFixed(0)}% ${l.toFixed(0)}%)`;
}

// By hypothesis of an object at the moment, its place from the best, 0 = best; by score, or by error.
export const ranksOf = memoized(
  (moment, by) => [moment?.arms, by],
  (moment, by = "score") => {
    const value = (a) => (by === "error" ? -(a.err ?? Infinity) : a.score ?? -1);
    const order = moment.arms.map((a, j) => j).sort((i, j) => value(moment.arms[j]) - value(moment.arms[i]) || i - j);
    const ranks = [];
    order.forEach((j, rank) => (ranks[j] = rank));
    return ranks;
  },
);
export function armColor(moment, arm, by = "score") {
  const n = moment.arms.length;
  return rampColor(n > 1 ? 1 - (ranksOf(moment, by)[arm] ?? n - 1) / (n - 1) : 1);
}

// Actions. Within known rows they only change the view; at the end they ask for more, and the cursor follows.

const ofIteration = { stage: null, moment: null, arm: null, edited: null };
let stageNext = false; // the next row that comes is shown stage by stage
let target = null; // the iteration that a link names, while its rows are yet to come
let pinned = false; // a link's iteration is shown: rows that come do not move the view
let timer = null;

const isKnown = () => state.runs.has(state.view.branch);
const known = () => runOf(state).rows.length;
const atEnd = () => state.view.k >= known();
const computes = () => state.running.branch != null;

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
  const names = (runOf(state).rows[k - 1]?.stages ?? []).map((one) => one.name);
  const at = names.indexOf(stage);
  if (at > 0) return setView({ stage: names[at - 1], moment: null });
  if (k > 0) setView({ k: k - 1, ...ofIteration });
}

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

export const isBusy = () => computes() || state.replaying != null;
export const toggleRun = () => (isBusy() ? pause() : run());

// Marks to stop at: every mark but a plain new best, of the object in focus where one was chosen.
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

// Shows iteration k, now or when its rows are there.
export function goTo(k) {
  stopReplay();
  target = k > known() ? k : null;
  pinned = target == null;
  setView({ k: Math.min(k, known()) });
}

// Plays the known rows; `state.speed` iterations a second.
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
  if (state.replaying) update({ replaying: null });
}

// Rows came: a view at the end stays at the end, unless a pose is edited.
export function followed(wasAtEnd, branch) {
  if (branch !== state.view.branch) return;
  const k = Math.min(known(), target ?? Infinity);
  if (target != null) {
    pinned = k === target;
    if (pinned) target = null;
  } else if ((pinned || !wasAtEnd) && state.view.k <= known()) return;
  const stage = stageNext && k > 0 ? runOf(state).rows[k - 1].stages[0].name : null;
  stageNext = stageNext && k === 0;
  if (state.view.edited) return; // what is edited is not taken away
  setView({ k, moment: null, arm: null, stage, edited: null });
}
