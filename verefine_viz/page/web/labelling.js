// The labels of the open frame: which one is in hand, what a press in the photo asks for, and what keys do to them.
import { send, setView, state, update } from "./store.js";
import { isLabelled, momentOf } from "./moment.js";

/** @import { AnyVerb, FrameLabels, LabelShown, PlaceableModel, Pose } from "./messages.d.ts" */
/** @import { State } from "./store.js" */
/** @typedef {[number, number]} Pixel */
/**
 * What is drawn in the photo to place a model: one pixel = a click; two corners of a box; a scribble.
 * @typedef {{ kind: "box" | "scribble", pixels: Pixel[] }} Sketch
 */

const MOST_SCRIBBLED = 10_000; // pixels that the server takes

/** @param {State} s */
export const isLabelling = (s) => isLabelled(s.frame) && s.view.preset === "label";

/** @type {LabelShown[]} */
const NONE = [];
/** @type {(s: State) => LabelShown[]} */
export const labelsOf = (s) => (s.labels?.frame === s.frame?.frame ? s.labels?.labels : null) ?? NONE;

/**
 * The label in hand: that of the object in focus.
 * @type {(s: State) => LabelShown | null}
 */
export function labelInHand(s) {
  const obj = isLabelling(s) ? momentOf(s)?.obj : null;
  return labelsOf(s).find((one) => one.obj === obj) ?? null;
}
/** @param {number} obj */
export const take = (obj) => setView({ obj, arm: null, moment: null, edited: null, model: null });
export function takeNext() {
  const labels = labelsOf(state);
  const at = labels.indexOf(labelInHand(state));
  if (labels.length) take(labels[(at + 1) % labels.length].obj);
}

// A model that is placed in the photo

/**
 * The model that the next press in the photo places.
 * @type {(s: State) => PlaceableModel | null}
 */
export const modelInHand = (s) => (isLabelling(s) && s.labels?.models.find((one) => one.obj_id === s.view.model)) || null;
/** @param {number} obj_id */
export const takeModel = (obj_id) => setView({ model: state.view.model === obj_id ? null : obj_id, edited: null });

/** @type {(models: PlaceableModel[], text: string) => PlaceableModel[]} */
export function modelsNamed(models, text) {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  return models.filter(({ name, obj_id }) => words.every((word) => `${name.toLowerCase()} ${obj_id}`.includes(word)));
}

/** @type {(pixel: Pixel, isScribble: boolean) => Sketch} */
export const sketchAt = (pixel, isScribble) => ({ kind: isScribble ? "scribble" : "box", pixels: [pixel] });

/** @type {(sketch: Sketch, pixel: Pixel) => Sketch} */
export function sketchedTo({ kind, pixels }, pixel) {
  if (kind === "box") return { kind, pixels: [pixels[0], pixel] };
  return { kind, pixels: [...pixels, ...between(pixels.at(-1), pixel)].slice(0, MOST_SCRIBBLED) };
}
// Pixels on the way from one, which is left out, to another.
/** @type {(from: Pixel, to: Pixel) => Pixel[]} */
function between([u0, v0], [u1, v1]) {
  const n = Math.max(Math.abs(u1 - u0), Math.abs(v1 - v0));
  return Array.from({ length: n }, (_, i) =>
    /** @type {Pixel} */ ([Math.round(u0 + ((u1 - u0) * (i + 1)) / n), Math.round(v0 + ((v1 - v0) * (i + 1)) / n)]));
}

/**
 * The corners of a box: left, top, right and bottom, the last two beyond it.
 * @type {(pixels: Pixel[]) => [number, number, number, number]}
 */
export function boxOf(pixels) {
  const [us, vs] = [0, 1].map((i) => pixels.map((pixel) => pixel[i]));
  return [Math.min(...us), Math.min(...vs), Math.max(...us) + 1, Math.max(...vs) + 1];
}

/**
 * What a sketch asks for: a click places the model, a box or a scribble searches for it there.
 * @type {(sketch: Sketch, obj_id: number) => AnyVerb}
 */
export function askedBy({ kind, pixels }, obj_id) {
  if (pixels.length === 1) return { verb: "place", obj_id, pixel: pixels[0] };
  return kind === "box" ? { verb: "find", obj_id, box: boxOf(pixels) } : { verb: "find", obj_id, scribble: pixels };
}

/** @param {Sketch} sketch */
export function ask(sketch) {
  const model = modelInHand(state);
  const isSent = model && send(askedBy(sketch, model.obj_id));
  update({ sketch: null, placing: Boolean(isSent) });
}

// Steps on a label

/** @param {Pose} [T]  to snap from; without it from where the label is, or was moved to */
export function snap(T) {
  const label = state.busy.text ? null : labelInHand(state);
  if (label) send({ verb: "snap", obj: label.obj, T: T ?? state.view.edited?.T ?? label.T });
}
/** @type {(label: LabelShown | null, state: "accepted" | "uncertain" | "proposed" | "removed", note?: string) => void} */
export function decide(label, state, note = "") {
  if (label) send({ verb: "decide", obj: label.obj, state, note });
}
/** @param {number} n  from 1 */
export function snapCandidate(n) {
  const candidate = labelInHand(state)?.candidates[n - 1];
  if (candidate) snap(candidate.T);
}
/** @param {State} s */
export const nextFrame = (s) => s.frame.frames[s.frame.frames.indexOf(s.frame.frame) + 1];

/**
 * How far the folder is: frames with labels, and of all their labels those still proposed, and those called uncertain.
 * @param {Record<string, FrameLabels>} frames
 */
export function progressOf(frames) {
  const all = Object.values(frames).filter((one) => one.labels);
  const sum = (/** @type {(one: FrameLabels) => number} */ of) => all.reduce((n, one) => n + of(one), 0);
  return { labelled: all.length, undecided: sum((one) => one.undecided), uncertain: sum((one) => one.labels - one.accepted - one.undecided) };
}
