// A pose that is edited, with the poses before and after it, which undo and redo go through.
import { samePose } from "./moment.js";

/** @import { Pose } from "./messages.d.ts" */
/** @import { Edited } from "./store.js" */

/**
 * At another pose. Poses of one gesture (a drag, a turn of the wheel) are one step until it rests; without a gesture each
 * is a step of its own.
 * @type {(edited: Edited, T: Pose, gesture?: string | null) => Edited}
 */
export function moved(edited, T, gesture = null) {
  if (samePose(edited.T, T)) return edited;
  const joins = gesture != null && gesture === edited.gesture;
  const past = edited.past ?? [];
  return { ...edited, T, gesture, rests: false, past: joins ? past : [...past, edited.T], future: [] };
}

/** @type {(edited: Edited) => Edited} */
export const rested = (edited) => ({ ...edited, gesture: null, rests: true });

/** @type {(edited: Edited) => Edited} */
export function undone(edited) {
  const { T, past = [], future = [] } = edited;
  if (!past.length) return edited;
  return { ...edited, T: past.at(-1), gesture: null, rests: false, past: past.slice(0, -1), future: [T, ...future] };
}

/** @type {(edited: Edited) => Edited} */
export function redone(edited) {
  const { T, past = [], future = [] } = edited;
  if (!future.length) return edited;
  return { ...edited, T: future[0], gesture: null, rests: false, past: [...past, T], future: future.slice(1) };
}
