// Outlines of poses, by object and pose. Those that a picture lacks are asked for together; those of a run, and maps of
// the iterations beside the one shown, when nothing else is to be done: moving through the run draws them at once.
import { state, want, arraysOf } from "./store.js";
import { momentOf, runOf, rowsOf } from "./moment.js";
import { mapsOf } from "./wants.js";

/** @import { Pose } from "./messages.d.ts" */
/** @import { Moment, NamedPose } from "./moment.js" */

const MOST_OUTLINES = 6000;
const CHUNK = 60; // poses in one want
const IDLE_MS = 120;

/** @type {Map<string, Path2D>} */
const outlines = new Map(); // key → Path2D in pixels of the image, where pixel u covers u … u + 1
/** @type {(Asked & { frame: number })[]} */
const under = []; // wants that are on their way: { frame, obj, poses, slot }
/** @type {(obj: number, T: Pose) => string} */
const keyOf = (obj, T) => `${state.frame.id} ${obj} ${T.join()}`;

export function outlineOf(obj, T, missing) {
  const key = keyOf(obj, T);
  const known = outlines.get(key);
  if (known) return known;
  if (missing) missing.push({ obj, T });
  return null;
}

/** @param {number[][]} polygons */
export function pathOf(polygons) {
  const path = new Path2D();
  for (const polygon of polygons) {
    path.moveTo(polygon[0] + 0.5, polygon[1] + 0.5);
    for (let i = 2; i < polygon.length; i += 2) path.lineTo(polygon[i] + 0.5, polygon[i + 1] + 0.5);
    path.closePath();
  }
  return path;
}

// Asks for what a picture lacks: one want an object. The latest wins.
export function askOutlines(missing, slot = "outlines") {
  for (const obj of new Set(missing.map((m) => m.obj))) {
    const poses = missing.filter((m) => m.obj === obj).slice(0, CHUNK).map((m) => m.T);
    ask({ obj, poses, slot: `${slot} ${obj}` });
  }
}

/** @typedef {{ obj: number, poses: Pose[], slot: string }} Asked */
/** @param {Asked} one */
function ask(one) {
  const at = under.findIndex((other) => other.slot === one.slot);
  if (at >= 0) under.splice(at, 1);
  under.push({ ...one, frame: state.frame.id });
  collect();
}

// Moves answers that came into the table; called before each drawing.
export function collect() {
  for (const one of [...under]) {
    const isOver = one.frame !== state.frame.id;
    const answer = isOver ? null : want({ what: "outlines", obj: one.obj, poses: one.poses }, one.slot);
    if (!answer && !isOver) continue;
    under.splice(under.indexOf(one), 1);
    (answer && "outlines" in answer ? answer.outlines : []).forEach((polygons, i) => outlines.set(keyOf(one.obj, one.poses[i]), pathOf(polygons)));
    while (outlines.size > MOST_OUTLINES) outlines.delete(outlines.keys().next().value);
  }
}

// Ahead: when nothing has changed for a while, outlines of all poses of the object's run and maps of its neighbours.

let idle = null;
export function prepareAhead() {
  clearTimeout(idle);
  idle = setTimeout(ahead, IDLE_MS);
}

function ahead() {
  const moment = momentOf(state);
  if (!moment || state.connection !== "open" || under.length || state.view.edited) return;
  const poses = new Map();
  const add = (T) => T && !outlines.has(keyOf(moment.obj, T)) && poses.set(T.join(), T);
  for (const arm of moment.starts) add(arm.T);
  for (const row of rowsOf(runOf(state), moment.obj)) {
    for (const stage of row.stages) add(stage.T);
    add(row.best?.T);
    if (poses.size >= CHUNK) break;
  }
  if (poses.size) ask({ obj: moment.obj, poses: [...poses.values()].slice(0, CHUNK), slot: `ahead ${moment.obj}` });
  else if (state.running.branch == null) neighbours(moment);
}

/** @param {Moment} moment */
function neighbours(moment) {
  for (const by of [1, -1]) {
    const k = moment.k + by;
    if (k < 0 || k > moment.run.rows.length) continue;
    const near = momentOf({ ...state, view: { ...state.view, k, stage: null } });
    if (near?.obj !== moment.obj) continue;
    const ahead = (/** @type {string} */ letter, /** @type {NamedPose | null} */ pose) => pose?.T && arraysOf(want(mapsOf(near, pose), `ahead ${letter} ${by}`));
    ahead("a", near.a);
    ahead("b", near.b);
  }
}
