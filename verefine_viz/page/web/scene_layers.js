// What the 3D view shows of a moment: the poses, and what lies around them, each a layer with the colour that it has there.
import { state, setView } from "./store.js";
import { labelOf, momentOf, samePose } from "./moment.js";
import { palette, rampColor, stageColor } from "./palette.js";
import { allowedOf, axesOf, isChosenBySense, isDrawn, toggleDrawn } from "./drawn_unasked.js";

/** @import { SceneLook } from "./messages.d.ts" */
/** @import { Moment, NamedPose } from "./moment.js" */
/** @import { Scene, State } from "./store.js" */

export const WHOLE = 4; // a box of so many diameters leaves everything in
/** @type {Scene} */
const DEFAULTS = { hidden: ["initial", "best", "hypotheses", "contacts"], cloud: "photo", box: WHOLE, cut: 0, gizmo: 170 };
/** @type {(s: State) => Scene} */
export const sceneOf = (s) => ({ ...DEFAULTS, ...s.view.scene });
/** @param {Partial<Scene>} patch */
export const setScene = (patch) => setView({ scene: { ...state.view.scene, ...patch } });
/** @param {string} key */
export function toggleLayer(key) {
  if (isChosenBySense(key)) return toggleDrawn(momentOf(state), key);
  const { hidden } = sceneOf(state);
  return setScene({ hidden: hidden.includes(key) ? hidden.filter((one) => one !== key) : [...hidden, key] });
}
/** @type {(s: State, moment: Moment, key: string) => boolean} */
export const isLayerShown = (s, moment, key) => (isChosenBySense(key) ? isDrawn(s, moment, key) : !sceneOf(s).hidden.includes(key));

/** @type {(key: string, isShown: boolean) => void} */
export function showLayer(key, isShown) {
  if (sceneOf(state).hidden.includes(key) === isShown) toggleLayer(key);
}

const NOT_STAGES = ["initial", "best", "runner-up", "edited", "ground truth"];

// The name of the pose at which the object in focus is drawn as a solid.
/** @type {(moment: Moment) => string | null} */
export function mainPoseOf({ poses, isAnswer }) {
  const stages = Object.keys(poses).filter((name) => !NOT_STAGES.includes(name));
  return ["edited", isAnswer ? "best" : stages.at(-1), "best", "initial"].find((name) => poses[name]) ?? null;
}

// Other poses of the object in focus, which are outlines; one that is the solid's is not drawn twice.
/** @type {(moment: Moment) => [string, NamedPose][]} */
export function outlinedOf(moment) {
  const main = mainPoseOf(moment);
  return Object.entries(moment.poses).filter(([name, { T }]) =>
    name !== main && (name === "ground truth" || !samePose(T, moment.poses[main]?.T)));
}

/** @type {Record<SceneLook["hidden"][number], string>} */
const AROUND = {
  "other objects": "other objects", cloud: "observed points", photo: "sensor and photo", plane: "support plane",
  gravity: "gravity", contacts: "contacts", overlaps: "overlaps", "own colours": "own colours",
};

/**
 * The layers of a moment: [{ key, label, color, hollow }]; hollow = an outline; null = they have no colour of their own.
 * @type {(s: State, moment: Moment) => { key: string, label: string, color: string | null, hollow?: boolean }[]}
 */
export function layersOf(s, moment) {
  const main = mainPoseOf(moment);
  const { support } = s.frame;
  const solid = main && { key: "main", label: labelOf(main, moment), color: stageColor(main) };
  const outlines = outlinedOf(moment).map(([name]) =>
    ({ key: name, label: labelOf(name, moment), color: stageColor(name), hollow: true }));
  const others = moment.scene.filter((o) => o.object.id !== moment.obj && o.T);
  /** @type {Record<string, [boolean, string | null]>} */
  const around = {
    "other objects": [others.length > 0, others[0]?.object.color],
    cloud: [true, null], photo: [true, null],
    plane: [support != null, palette.scene.plane], gravity: [support != null, palette.scene.gravity],
    contacts: [moment.row?.path != null && !moment.isAnswer, palette.scene.contacts],
    overlaps: [support != null && moment.scene.length > 1, palette.scene.overlaps],
    "own colours": [true, null],
  };
  return [
    ...(solid ? [solid] : []), ...outlines,
    ...(s.view.edited?.rests ? [{ key: "end", label: "refined from here", color: stageColor("refined"), hollow: true }] : []),
    ...(moment.beside ? [{ key: "B", label: "the run beside", color: palette.sides.B, hollow: true }] : []),
    ...(allowedOf(moment) ? [{ key: "allowed", label: "allowed by the image", color: palette.scene.allowed }] : []),
    ...(axesOf(moment).length ? [{ key: "axes", label: "axes", color: palette.axes[0] }] : []),
    ...(moment.arms.length > 1
      ? [{ key: "hypotheses", label: `${moment.arms.length} hypotheses`, color: rampColor(1, "dark") }] : []),
    ...Object.entries(around).filter(([, [isThere]]) => isThere)
      .map(([key, [, color]]) => ({ key, label: AROUND[key], color })),
  ];
}

// What a file shows in 3D, which is the end of the run wherever the cursor is (look_at_end of scene3d/view_content.py).
/** @type {(s: State) => ReturnType<typeof layersOf>} */
export function layersAtEnd({ frame }) {
  const objects = frame?.objects.filter((o) => o.arms.length) ?? [];
  return [
    { key: "main", label: "answer", color: stageColor("best") },
    ...(objects.some((o) => o.has_gt) ? [{ key: "ground truth", label: "ground truth", color: stageColor("ground truth"), hollow: true }] : []),
    ...(frame?.support ? [{ key: "plane", label: AROUND.plane, color: palette.scene.plane }, { key: "gravity", label: AROUND.gravity, color: palette.scene.gravity }] : []),
  ];
}

// What of the frame the server draws beside poses, and how.
/** @type {(s: State) => SceneLook} */
export function sceneLook(s) {
  const { hidden, cloud, box, cut, gizmo } = sceneOf(s);
  const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
  const around = /** @type {SceneLook["hidden"]} */ (hidden.filter((key) => key in AROUND));
  return { hidden: around, cloud, box, cut, gizmo_px: gizmo, text_px: Math.round(0.9 * rem) };
}

// The depth tolerance of a branch [mm], to which colours of distances go half.
/** @type {(s: State, branch: number) => number} */
export function toleranceOf(s, branch) {
  const changed = s.branches.find((b) => b.index === branch)?.settings["score.tau_m"];
  return 1000 * Number(changed ?? s.frame.tau_m);
}
