// What the server is asked at a moment: it draws, scores and checks the poses that it is given here.
import { state, want } from "./store.js";
import { momentOf, rankShares, samePose } from "./moment.js";
import { allowedOf, axesOf, isDrawn } from "./drawn_unasked.js";
import { mainPoseOf, outlinedOf, sceneLook, sceneOf } from "./scene_layers.js";

/** @import { CropsWanted, DrawnHypothesis, DrawnPose, LandscapeWanted, Look, MapsWanted, PhysicsWanted, Pose, RefinedAnswer, RefinedWanted, Standing } from "./messages.d.ts" */
/** @import { Moment, NamedPose } from "./moment.js" */
/** @import { Edited, State } from "./store.js" */

// Settings of the score hold from one change to the next: the first iteration scored like iteration k stands for all.
/** @type {(branch: number, k: number) => number} */
export function scoredAt(branch, k) {
  const { scored = [] } = state.branches.find((b) => b.index === branch) ?? {};
  return 1 + (scored.findLast((after) => after < Math.max(k, 1)) ?? 0);
}
const scoredNow = (/** @type {Moment} */ moment) => scoredAt(moment.branch, moment.k + (moment.isAnswer ? 1 : 0));

// Maps

/** @type {WeakMap<NamedPose, MapsWanted>} */
const wanted = new WeakMap();
/** @type {(moment: Moment, pose: NamedPose) => MapsWanted} */
export function mapsOf(moment, pose) {
  if (!wanted.has(pose)) {
    const branch = pose.branch ?? moment.branch;
    const k = scoredAt(branch, pose.k ?? moment.k);
    /** @type {Pick<MapsWanted, "obj" | "T" | "poses">} */
    const posed = pose.poses ? { obj: null, poses: pose.poses } : { obj: moment.obj, T: pose.T };
    wanted.set(pose, { what: "maps", branch, k, ...posed });
  }
  return wanted.get(pose);
}

// Physics

// Poses of the focus that are looked at more closely, each once: before and after, or the answer alone.
/** @type {(moment: Moment) => string[]} */
export function comparedByPhysics(moment) {
  const { poses, isAnswer } = moment;
  const wanted = poses.edited ? [poses.accepted ? "accepted" : "best", "edited"]
    : isAnswer || !poses.accepted ? ["current", "best"] : ["current", "simulated", "accepted"];
  const names = wanted.filter((name) => poses[name]);
  return names.filter((name, i) => !names.slice(i + 1).some((other) => samePose(poses[name].T, poses[other].T)));
}

/** @type {(moment: Moment) => Standing[]} */
const standsOf = (moment) => moment.scene.filter((o) => o.T)
  .map((o) => /** @type {Standing} */ ([o.object.id, o.T, o.phase === "waiting"]));

// Of an iteration that is shown stage by stage, it is about all of it.
/** @type {(s: State, partial: Moment) => PhysicsWanted} */
export function physicsOf(s, partial) {
  const moment = partial.isPartial ? momentOf({ ...s, view: { ...s.view, stage: partial.stages.at(-1) } }) : partial;
  const isEdited = s.view.edited?.obj === moment.obj;
  return {
    what: "physics", branch: moment.branch, k: scoredNow(moment), obj: moment.obj, alone: isEdited, stands: standsOf(moment),
    poses: comparedByPhysics(moment).map((name) => [name, moment.poses[name].T]),
    path: moment.row?.k ?? null,
  };
}

// Where refining from the edited pose ends, among the objects where they stand: asked for once the pose rests, and void
// when it is moved again.
/** @type {WeakMap<Edited, RefinedWanted>} */
const refinedFrom = new WeakMap();
/** @type {(s: State, moment: Moment) => RefinedAnswer | null} */
export function endOf(s, moment) {
  const { edited } = s.view;
  if (!edited?.rests || edited.obj !== moment.obj) return null;
  if (!refinedFrom.has(edited)) {
    refinedFrom.set(edited, { what: "refined", branch: moment.branch, obj: edited.obj, T: edited.T, stands: standsOf(moment) });
  }
  const answer = want(refinedFrom.get(edited), "refined");
  return answer && !("gone" in answer) ? answer : null;
}

// The score around the best pose, and what a learned refiner saw: of an answer, in the iteration that made it.
/**
 * @param {Moment} moment
 * @returns {LandscapeWanted}
 */
export const landscapeOf = (moment) =>
  ({ what: "landscape", branch: moment.branch, k: scoredNow(moment), obj: moment.obj, T: moment.best.T });
/** @type {(moment: Moment) => CropsWanted | null} */
export function cropsOf(moment) {
  const k = (moment.isAnswer && moment.best?.k) || moment.row?.k;
  return k ? { what: "crops", branch: moment.branch, k } : null;
}

// The poses of the object in focus whose maps are saved as a picture.
/** @type {(moment: Moment) => [string, Pose][]} */
export function savedMaps(moment) {
  const { poses, isAnswer } = moment;
  const name = isAnswer ? "best" : poses.accepted ? "accepted" : "initial";
  /** @type {[string, NamedPose | undefined][]} */
  const shown = [[isAnswer ? "answer" : name, poses[name]], ["ground truth", poses["ground truth"]]];
  return shown.filter(([, pose]) => pose).map(([label, pose]) => [label, pose.T]);
}

// The 3D view

const FOCUS = 0.9;
const GIZMO = 0.75;
const OPACITY = { waiting: 0.16, paused: 0.16, working: 0.8, placed: 0.8, "rolled out": 0.3, done: 0.8 };
// Solids have an opacity, outlines none.
/** @type {(s: State, moment: Moment) => DrawnPose[]} */
function drawnAt(s, moment) {
  const main = mainPoseOf(moment);
  const { hidden } = sceneOf(s);
  const isGizmo = main === "edited" && s.view.edited?.obj === moment.obj;
  const others = moment.scene.filter((o) => o.object.id !== moment.obj && o.T);
  const end = endOf(s, moment);
  return [
    ...others.map((o) => /** @type {DrawnPose} */ ([o.object.id, o.T, "body", OPACITY[o.phase]])),
    ...outlinedOf(moment).filter(([name]) => !hidden.includes(name))
      .map(([name, { T }]) => /** @type {DrawnPose} */ ([moment.obj, T, name, 0])),
    ...(main && (isGizmo || !hidden.includes("main"))
      ? [/** @type {DrawnPose} */ ([moment.obj, moment.poses[main].T, isGizmo ? "gizmo" : main, isGizmo ? GIZMO : FOCUS])] : []),
    ...(end && !hidden.includes("end") ? [/** @type {DrawnPose} */ ([moment.obj, end.T, "refined", 0])] : []),
    ...(hidden.includes("B") ? [] : moment.beside?.scene ?? []).filter((o) => o.T).map((o) => /** @type {DrawnPose} */ ([o.object.id, o.T, "B", 0])),
  ];
}

// By hypothesis of the object in focus, where it is now and its place among them, as its colour says.
/** @type {(moment: Moment) => DrawnHypothesis[]} */
function hypothesesAt(moment) {
  const shares = rankShares(moment.run, moment.object);
  return moment.arms.map((arm, j) => /** @type {[Pose, number]} */ ([arm.T, shares[j] ?? 0])).filter(([T]) => T);
}

/** @type {(s: State, moment: Moment | null) => Look | null} */
export function lookAt(s, moment) {
  if (!moment) return s.frame && { verb: "look", branch: s.view.branch, obj: null, scene: sceneLook(s), pixel: s.view.pixel, ruler: s.view.ruler };
  const path = !moment.isAnswer && !moment.poses.edited && moment.row?.path ? { k: moment.row.k, moment: s.view.moment } : null;
  const T = (moment.poses.edited ?? moment.best)?.T;
  return {
    verb: "look", branch: moment.branch, k: scoredNow(moment), obj: moment.obj, draw: drawnAt(s, moment),
    hypotheses: sceneOf(s).hidden.includes("hypotheses") ? [] : hypothesesAt(moment), arm: moment.arm,
    allowed: isDrawn(s, moment, "allowed") ? allowedOf(moment)?.poses ?? [] : [], axes: isDrawn(s, moment, "axes") ? axesOf(moment).map(([, T]) => T) : [], path, grasp: s.view.grasp && T ? { ...s.view.grasp, T } : null,
    scene: sceneLook(s), pixel: s.view.pixel, ruler: s.view.ruler,
  };
}
