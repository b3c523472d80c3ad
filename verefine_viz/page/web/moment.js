// What stands where at the cursor, derived from the rows of the run.
import { state } from "./store.js";
import { rampColor } from "./palette.js";

const NO_RUN = { rows: [], marks: [], notes: [], missing: "", total: 0, over: false, start: null };

/** @type {(s: State, branch?: number) => Run} */
export const runOf = (s, branch = s.view.branch) => s.runs.get(branch) ?? NO_RUN;

/**
 * Returns the same object for the same inputs; the last few results of each function are cached.
 * @template {unknown[]} A
 * @template V
 * @param {(...args: A) => unknown[]} inputs
 * @param {(...args: A) => V} work
 * @returns {(...args: A) => V}
 */
function memoized(inputs, work, keep = 4) {
  /** @type {{ key: unknown[], value: V }[]} */
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

// Whether a frame is open for labelling: before a run, its objects stand at the poses of their labels.
/** @type {(frame: State["frame"]) => boolean} */
export const isLabelled = (frame) => frame?.source === "labels";

/** @type {(a: Pose | null | undefined, b: Pose | null | undefined) => boolean} */
export const samePose = (a, b) => a === b || (a != null && b != null && a.every((x, i) => x === b[i]));

// Rows by object, in order; appended rows make a new run object, so identity is a sufficient key.
const rowsByObject = memoized(
  (/** @type {Run} */ run) => [run],
  (run) => {
    /** @type {Map<number, IterationRow[]>} */
    const own = new Map();
    for (const row of run.rows) own.has(row.obj) ? own.get(row.obj).push(row) : own.set(row.obj, [row]);
    return own;
  },
  6,
);
/** @type {(run: Run, obj: number) => IterationRow[]} */
export const rowsOf = (run, obj) => rowsByObject(run).get(obj) ?? [];

/**
 * The latest of `rows` with row.k ≤ k, or undefined.
 * @param {IterationRow[]} rows
 * @param {number} k
 */
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

/** @type {(run: Run, object: FrameObject) => InitialPose[]} */
export const startsOf = (run, object) => run.start?.[object.id] ?? object.arms;

// The source of a hypothesis; "" where all have the same one.
/** @type {(moment: Pick<Moment, "starts">, arm: number) => string} */
export function sourceOf({ starts }, arm) {
  const stem = (/** @type {InitialPose} */ a) => (a.source ?? "").replace(/ #\d+$/, "");
  return starts[arm] && new Set(starts.map(stem)).size > 1 ? stem(starts[arm]) : "";
}

/** @type {(run: Run, object: FrameObject) => KnownBest | null} */
function bestStart(run, object) {
  let arm = -1;
  startsOf(run, object).forEach((a, j, all) => {
    if (arm < 0 || (a.score ?? 0) > (all[arm].score ?? 0)) arm = j;
  });
  if (arm < 0) return null;
  const { T, score, err } = startsOf(run, object)[arm];
  return { T, score, err, arm, k: 0, stage: "initial" };
}

// An object's best pose after iteration k; of a finished run its answer, which may be another: some methods answer
// with the best scene.
/** @type {(run: Run, object: FrameObject, k: number, outcome: JudgedObject | null) => KnownBest | null} */
function bestAt(run, object, k, outcome) {
  if (outcome?.T) {
    const { T, score, err, deg, mm, arm, k: made, stage } = outcome;
    return { T, score, err, deg, mm, arm, k: made, stage };
  }
  const row = latest(rowsOf(run, object.id), k);
  return row ? row.best : bestStart(run, object);
}

/** @typedef {"waiting" | "working" | "placed" | "rolled out" | "done" | "paused" | "no pose"} Phase */

/**
 * Part of an object in an iteration. waiting: its turn is still to come; working: the iteration is about it; placed: it
 * stood in the scene; rolled out: a tree search completed the scene with it; paused: its turn comes again.
 * @type {(object: FrameObject, row: IterationRow | null, own: IterationRow | undefined, best: KnownBest | null,
 *   isLast: boolean) => Phase}
 */
function phaseOf({ id }, row, own, best, isLast) {
  if (!best) return "no pose";
  if (row?.obj === id) return "working";
  if (row?.placed?.some((p) => p.obj === id)) return "placed";
  if (row?.tree?.rollout?.some((p) => p.obj === id)) return "rolled out";
  if (!own) return "waiting";
  const takesTurns = (row.pass || row.tree) && own.cluster === row.cluster; // clusters are solved one after another
  return takesTurns || !isLast ? "paused" : "done";
}

// All objects of the frame at iteration k; the one in focus is at `shown`.
/** @type {(s: State, run: Run, k: number, isAnswer: boolean, shown: Pose | undefined) => Moment["scene"]} */
function sceneAt(s, run, k, isAnswer, shown) {
  const row = isAnswer ? null : run.rows[k - 1];
  const others = [...(row?.placed ?? []), ...(row?.tree?.rollout ?? [])];
  const stands = new Map(others.map((p) => /** @type {const} */ ([p.obj, p.T])));
  return s.frame.objects.map((object) => {
    const verdict = isAnswer ? verdictOf(s, object.id) : null;
    const best = bestAt(run, object, k, verdict);
    const own = latest(rowsOf(run, object.id), k);
    const isLast = own != null && rowsOf(run, object.id).at(-1) === own;
    const phase = isAnswer && best ? "done" : phaseOf(object, row, own, best, isLast);
    const T = row?.obj === object.id ? shown : stands.get(object.id) ?? best?.T ?? null;
    return { object, phase, best, T, score: best?.score ?? null, err: best?.err ?? null, spent: own?.own ?? 0, verdict };
  });
}

/**
 * Which hypothesis was edited, and how far.
 * @param {import("./messages.d.ts").MovedPose} edit
 * @param {FrameObject[]} objects
 */
export function editWords({ obj, arm, mm, deg }, objects) {
  const of = objects.length > 1 ? ` of ${objects.find((o) => o.id === obj)?.label ?? `object ${obj}`}` : "";
  const far = mm == null ? "" : `, ${mm.toFixed(1)} mm and ${deg.toFixed(1)}° from its initial pose`;
  return `Hypothesis ${arm + 1}${of} edited${far}`;
}

/** @type {(s: State, obj: number, branch?: number) => JudgedObject | null} */
export const verdictOf = (s, obj, branch = s.view.branch) =>
  s.verdicts.get(branch)?.objects.find((o) => o.obj === obj) ?? null;

/**
 * The object that a finished run names first: wrong before doubtful, the farthest from its limit first.
 * @param {import("./messages.d.ts").VerdictMessage | undefined} verdict
 */
export function worstOf(verdict) {
  const rank = { wrong: 0, none: 1, doubt: 2, unknown: 3, right: 4 };
  const excess = (/** @type {JudgedObject} */ o) => (o.err != null && o.limit ? o.err / o.limit : 1 - (o.score ?? 0));
  return [...(verdict?.objects ?? [])].sort((a, b) => rank[a.tone] - rank[b.tone] || excess(b) - excess(a))[0] ?? null;
}

/** @import { ArmState, BestPose, FrameObject, InitialPose, IterationRow, JudgedObject, Pose, ScoredStage } from "./messages.d.ts" */
/** @import { Run, State, View } from "./store.js" */

/**
 * A pose with what is known of it. `stage` is its kind: a stage, initial, best, runner-up, edited or ground truth; of A
 * and B so is `name`, and `label` says it. `poses` stand for `T` where several objects are compared at once.
 * @typedef {Partial<Omit<ScoredStage, "name"> & Omit<BestPose, "stage">> & { stage?: string, name?: string,
 *   label?: string, branch?: number, poses?: [number, Pose][] }} NamedPose
 */

/**
 * What stands where at the cursor.
 * @typedef {object} Moment
 * @property {number} branch
 * @property {Run} run
 * @property {number} k  the iteration that is shown; 0 = before the first
 * @property {number} total
 * @property {boolean} over
 * @property {IterationRow | null} at  iteration k
 * @property {IterationRow | null} row  the latest iteration on the object
 * @property {boolean} isCurrent  whether `row` is iteration k
 * @property {boolean} isAnswer  whether the answers of the finished run are shown
 * @property {boolean} isPartial  whether only stages before the iteration's last are shown
 * @property {number} obj
 * @property {FrameObject} object
 * @property {InitialPose[]} starts
 * @property {number} arm  the hypothesis in focus
 * @property {ArmState[]} arms
 * @property {KnownBest | null} best
 * @property {Record<string, NamedPose>} poses  by their kind
 * @property {string[]} stages
 * @property {string | null} stage
 * @property {JudgedObject | null} verdict
 * @property {{ object: FrameObject, phase: Phase, best: KnownBest | null, T: Pose | null, score: number | null,
 *   err: number | null, spent: number, verdict: JudgedObject | null }[]} scene
 * @property {Own | null} beside  the moment of the run beside it
 * @property {NamedPose | null} a  the poses that are compared
 * @property {NamedPose | null} b
 * @property {boolean} same  whether both are one pose
 */

/**
 * The best pose of an object so far; of an initial pose, its stage is "initial".
 * @typedef {Partial<BestPose> & Pick<BestPose, "T" | "score" | "err" | "arm" | "k" | "stage">} KnownBest
 */
/** @typedef {Pick<Moment, "a" | "b" | "same">} Pair */
/** @typedef {Omit<Moment, keyof Pair | "beside">} Own  what a run shows alone */
/**
 * @typedef {Pick<Moment, "row" | "stages" | "isCurrent" | "isPartial" | "stage"> & { cut: number,
 *   results: IterationRow | null }} Iteration  cut: how many of its stages are shown
 */
/**
 * @typedef {Omit<Iteration, "results"> & Pick<Moment, "k" | "isAnswer" | "object" | "starts" | "arms" | "best"
 *   | "verdict">} Known
 */

/**
 * Everything about (branch, k, stage, obj) of the view, or null before a frame is open.
 * @type {(s: State) => Moment | null}
 */
export const momentOf = memoized(
  (/** @type {State} */ s) => [s.frame, s.branches, s.runs.get(s.view.branch), s.verdicts.get(s.view.branch), s.view, s.compare,
    s.compare && s.runs.get(other(s))],
  (s) => {
    const moment = momentAt(s, s.view);
    if (!moment) return null;
    const isCompared = s.compare && [s.compare.a, s.compare.b].includes(s.view.branch);
    const beside = isCompared && s.view.branch !== other(s) ? momentBeside(s, moment) : null;
    return { ...moment, beside, ...pairOf(s, moment, beside) };
  },
);

/** @param {State} s */
const other = (s) => (s.view.branch === s.compare.b ? s.compare.a : s.compare.b);

/** @type {(s: State, moment: Own) => Own | null} */
function momentBeside(s, moment) {
  const run = s.runs.get(other(s));
  if (!run) return null;
  const k = moment.isAnswer ? run.rows.length : Math.min(s.view.beside ?? moment.k, run.rows.length);
  return momentAt(s, { ...s.view, branch: other(s), k, stage: null, edited: null, moment: null, obj: moment.obj });
}

// The object in focus: the one chosen, else at an answer the worst, else that of the iteration.
/** @type {(s: State, view: View, run: Run, k: number, isAnswer: boolean) => FrameObject | null} */
function focusOf(s, view, run, k, isAnswer) {
  const verdict = s.verdicts.get(view.branch);
  const worst = isAnswer ? verdict?.scene?.worst ?? worstOf(verdict)?.obj : null;
  const obj = view.obj ?? worst ?? run.rows[k - 1]?.obj;
  return s.frame.objects.find((o) => o.id === obj) ?? s.frame.objects.find((o) => startsOf(run, o).length)
    ?? s.frame.objects[0] ?? null;
}

// The latest iteration on the object, as far as it is shown. `results`: the latest iteration whose results are shown,
// the one before while this one's last stage is not shown yet.
/** @type {(run: Run, obj: number, k: number, stage: string | null) => Iteration} */
function iterationOf(run, obj, k, stage) {
  const own = rowsOf(run, obj);
  const row = latest(own, k) ?? null;
  /** @type {string[]} */
  const stages = row ? row.stages.map((one) => one.name) : [];
  const isCurrent = row != null && row.k === k;
  const cut = isCurrent && stages.includes(stage) ? stages.indexOf(stage) + 1 : stages.length;
  const isPartial = cut < stages.length;
  return { row, stages, isCurrent, cut, isPartial, stage: isPartial ? stage : null,
    results: isPartial ? latest(own, row.k - 1) : row };
}

/** @type {(results: IterationRow | null, starts: InitialPose[]) => ArmState[]} */
const armsAt = (results, starts) => (results ? results.arms
  : starts.map((a) => ({ plays: a.plays ?? 0, mean: a.mean ?? a.score, score: a.score, err: a.err, T: a.T })));

// The hypothesis in focus: the one chosen, else that of the answer or of the iteration.
/** @type {(view: View, known: Known) => number} */
function armAt(view, { isAnswer, best, row, arms }) {
  const own = isAnswer ? best?.arm : row?.arm ?? best?.arm;
  return Math.min(view.arm ?? own ?? 0, Math.max(arms.length - 1, 0));
}

// The poses of the iteration's stages; before the first iteration, the hypothesis's initial pose.
/** @type {(m: Known & { arm: number }) => Record<string, NamedPose>} */
function stagesAt({ isAnswer, isPartial, row, cut, arms, arm }) {
  if (isAnswer) return {};
  if (!row) return arms[arm] ? { current: { ...arms[arm], arm } } : {};
  const poses = Object.fromEntries(row.stages.slice(0, cut).map((one) => [one.name, { ...one, arm: row.arm }]));
  if (isPartial) return poses;
  return { ...poses, accepted: { ...row.stages.find((one) => one.name === row.accepted), arm: row.arm } };
}

// The pose being edited, or the edited one with which the branch goes on after this iteration.
/** @type {(s: State, view: View, m: Known) => NamedPose | null} */
function editedAt(s, view, { isAnswer, isPartial, object, arms, k }) {
  if (view.edited) return view.edited.obj === object.id ? { T: view.edited.T, arm: view.edited.arm } : null;
  if (isAnswer || isPartial) return null;
  const edits = s.branches.find((b) => b.index === view.branch)?.edits ?? [];
  const moved = edits.find((e) => e.k === k && e.obj === object.id);
  const one = moved && arms[moved.arm];
  return moved ? { ...(samePose(one?.T, moved.T) ? one : {}), T: moved.T, arm: moved.arm } : null;
}

/** @type {(m: Known) => NamedPose | null} */
function runnerUpOf({ isAnswer, verdict }) {
  if (!isAnswer || !verdict?.runner_up) return null;
  const { T, arm, lead } = verdict.runner_up;
  return { T, arm, score: verdict.score - lead, err: null };
}

// The poses of the object by kind, each with its kind as `stage`.
/** @type {(s: State, view: View, m: Known & { arm: number }) => Record<string, NamedPose>} */
function posesAt(s, view, m) {
  const { object, starts, arm, best } = m;
  /** @type {Record<string, NamedPose | null>} */
  const poses = {
    initial: starts[arm] ? { ...starts[arm], arm } : null,
    ...stagesAt(m),
    best: best ? { ...best } : null,
    "runner-up": runnerUpOf(m),
    edited: editedAt(s, view, m),
    "ground truth": object.gt ? { T: object.gt, err: 0, score: object.gt_score ?? null } : null,
  };
  const isLabel = isLabelled(s.frame) && !m.row; // initial, current and best are one
  return Object.fromEntries(Object.entries(poses).filter(([name, pose]) => pose && !(isLabel && ["initial", "best"].includes(name)))
    .map(([name, pose]) => [name, { ...pose, stage: name }]));
}

// The pose of the object in focus among the others.
/** @type {(m: Known, poses: Record<string, NamedPose>) => Pose | undefined} */
function standsAt({ isPartial, row, cut, best }, poses) {
  if (isPartial) return row.stages[cut - 1].T;
  return row ? (poses.edited ?? poses.accepted ?? poses.best).T : best?.T;
}

/** @type {(s: State, view: View) => Own | null} */
function momentAt(s, view) {
  if (!s.frame) return null;
  const run = runOf(s, view.branch);
  const k = Math.min(view.k, run.rows.length);
  const isPlain = view.stage == null && view.moment == null && !view.edited;
  const isAnswer = run.over && k > 0 && k === run.rows.length && isPlain;
  const object = focusOf(s, view, run, k, isAnswer);
  if (!object) return null;
  const { results, ...iteration } = iterationOf(run, object.id, k, view.stage);
  const verdict = verdictOf(s, object.id, view.branch);
  const starts = startsOf(run, object);
  const best = bestAt(run, object, results?.k ?? 0, isAnswer ? verdict : null);
  const known = { ...iteration, k, isAnswer, object, starts, arms: armsAt(results, starts), best, verdict };
  const m = { ...known, arm: armAt(view, known) };
  const poses = posesAt(s, view, m);
  return {
    ...m, poses, branch: view.branch, run, total: run.total, over: run.over, at: run.rows[k - 1] ?? null, obj: object.id,
    scene: sceneAt(s, run, k, isAnswer, standsAt(m, poses)),
  };
}

// A and B where two runs are compared: their answers, or the poses that their iterations accepted.
/** @type {(s: State, moment: Own, beside: Own) => Pair | null} */
function pairOfRuns(s, moment, beside) {
  /** @type {(m: Own, letter: string) => NamedPose | undefined} */
  const side = (m, letter) => {
    const name = m.isAnswer || !m.poses.accepted ? "best" : "accepted";
    const title = s.branches.find((b) => b.index === m.branch)?.name ?? "";
    const label = title.startsWith(`${letter}: `) ? title : `${letter}: ${title}`;
    return m.poses[name] && { name, ...m.poses[name], label, branch: m.branch, k: m.k };
  };
  const isFirst = s.view.branch === s.compare.a;
  const [a, b] = isFirst ? [side(moment, "A"), side(beside, "B")] : [side(beside, "A"), side(moment, "B")];
  return a && b ? { a, b, same: samePose(a.T, b.T) } : null;
}

// Names of A and B, the most telling pair first. The answer, and before it the best so far, is always A, the pose
// compared with it always B; of two stages of an iteration the earlier one is A.
/** @type {(moment: Own) => string[][]} */
function pairsWorthShowing({ poses, isAnswer, verdict, row }) {
  const edited = poses.edited ? [["accepted", "edited"], ["current", "edited"], ["best", "edited"]] : [];
  const isWrong = verdict?.tone === "wrong";
  const answer = isAnswer ? [
    ...(isWrong ? [["best", "ground truth"]] : []),
    ...(poses["ground truth"] ? [] : [["best", "runner-up"]]),
    ["best", "initial"], ["best", "runner-up"], ["best", "ground truth"],
  ] : [];
  const flipped = row?.accepted === "flipped" ? [["refined", "flipped"]] : [];
  return [
    ...edited, ...answer, ...flipped, ["simulated", "refined"], ["current", "refined"], ["current", "simulated"],
    ["current", "accepted"], ["best", "ground truth"], ["best", "initial"], ["current", "ground truth"],
  ];
}

// A and B: the user's choice, else the most telling pair; the same pose twice only where there is no other.
/** @type {(s: State, moment: Own, beside: Own | null) => Pair} */
function pairOf(s, moment, beside) {
  const { poses } = moment;
  const runs = beside && !s.view.edited ? pairOfRuns(s, moment, beside) : null;
  if (runs) return runs;
  const isThere = (/** @type {string[]} */ [a, b]) => poses[a] && poses[b];
  const isSame = (/** @type {string[]} */ [a, b]) => samePose(poses[a]?.T, poses[b]?.T);
  const chosen = [s.view.a, s.view.b];
  const pairs = pairsWorthShowing(moment).filter(isThere);
  const [a, b] = isThere(chosen) ? chosen
    : pairs.find((pair) => !isSame(pair)) ?? pairs[0] ?? [Object.keys(poses)[0], undefined];
  /** @param {string} name */
  const named = (name) => (poses[name] ? { name, label: labelOf(name, moment), ...poses[name] } : null);
  return { a: named(a), b: named(b), same: Boolean(poses[a] && poses[b] && isSame([a, b])) };
}

// Only methods that verify keep the best pose; others, and recorded steps, continue from their last one.
/** @param {number} branch */
export function bestWords(branch) {
  const name = state.branches.find((b) => b.index === branch)?.settings["method.name"] ?? state.frame.method;
  return state.frame.choices.methods.find((m) => m.name === name)?.verifies ? "best so far" : "pose so far";
}
/** @type {(name: string, moment: Pick<Moment, "isAnswer" | "branch" | "row">) => string} */
export const labelOf = (name, moment) => (name === "best" ? (moment.isAnswer ? "answer" : bestWords(moment.branch))
  : name === "current" && !moment.row && isLabelled(state.frame) ? "label" : name);

// Rank of each hypothesis of an object at the moment, 0 = best; by score, or by error.
export const ranksOf = memoized(
  (/** @type {Moment} */ moment, /** @type {string} */ by = "score") => [moment?.arms, by],
  (moment, by = "score") => {
    const value = (/** @type {ArmState} */ a) => (by === "error" ? -(a.err ?? Infinity) : a.score ?? -1);
    const order = [...moment.arms.keys()].sort((i, j) => value(moment.arms[j]) - value(moment.arms[i]) || i - j);
    /** @type {number[]} */
    const ranks = [];
    order.forEach((j, rank) => (ranks[j] = rank));
    return ranks;
  },
);
// Relative rank by score of each hypothesis of an object in the run so far, 0 = the lowest, 1 = the highest. It is the
// same at every iteration, so that a hypothesis has one colour wherever it is drawn.
export const rankShares = memoized(
  (/** @type {Run} */ run, /** @type {FrameObject} */ object) => [run, object],
  (run, object) => {
    /** @type {{ score?: number | null }[]} */
    const arms = rowsOf(run, object.id).at(-1)?.arms ?? startsOf(run, object);
    const order = [...arms.keys()].sort((i, j) => (arms[j].score ?? -1) - (arms[i].score ?? -1) || i - j);
    /** @type {number[]} */
    const shares = [];
    order.forEach((j, rank) => (shares[j] = order.length > 1 ? 1 - rank / (order.length - 1) : 1));
    return shares;
  },
  32,
);
/** @type {(moment: Pick<Moment, "run" | "object">, arm: number, theme?: string) => string} */
export const armColor = ({ run, object }, arm, theme) => rampColor(rankShares(run, object)[arm] ?? 0, theme);
