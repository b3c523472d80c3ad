// The two poses that are compared, A and B, with their maps; canvases and pictures that are drawn from them.
import { state, want, forget, arraysOf, blob, changed, addressOf } from "./store.js";
import { mapsOf } from "./wants.js";
import { momentOf } from "./moment.js";
import { MAPS, gainOf, paint, valueAt } from "./colours.js";

/** @import { MapsAnswer, MapScale, Pose } from "./messages.d.ts" */
/** @import { Moment, NamedPose, Pair } from "./moment.js" */
/** @import { Mapped } from "./colours.js" */
/** @import { Arrays } from "./store.js" */

/**
 * A pose with its maps, as far as they are there.
 * @typedef {Partial<Mapped> & { pose: NamedPose, letter: string, stale: boolean, gone: string | null }} Side
 */
/** @typedef {{ a: Side | null, b: Side | null, same: boolean, gain: Mapped | null }} Sides */

// Poses

// What is compared: poses of the object, or with `together` all objects as they stand and as they truly are; one whose
// ground truth is unknown stays where it is, so that both scenes have the same objects.
/** @type {WeakMap<Moment, Pair>} */
const pairs = new WeakMap(); // moment → pair
/** @type {(moment: Moment) => Pair} */
function pairOf(moment) {
  if (!state.view.together || moment.scene.length < 2) return moment;
  if (!pairs.has(moment)) pairs.set(moment, wholeScene(moment));
  return pairs.get(moment);
}
/** @type {(moment: Moment) => Pair} */
function wholeScene(moment) {
  /** @type {(of: (o: Moment["scene"][number]) => Pose | null) => [number, Pose][]} */
  const posed = (of) => moment.scene.map((o) => /** @type {[number, Pose]} */ ([o.object.id, of(o)])).filter(([, T]) => T);
  const known = moment.scene.filter((o) => o.object.gt).length;
  const [stands, true_] = [posed((o) => o.T), known ? posed((o) => o.object.gt ?? o.T) : []];
  const label = known < moment.scene.length ? "ground truth where known" : "ground truth";
  return { a: stands.length ? { name: "scene", label: "as they stand", poses: stands } : null, same: false,
    b: true_.length ? { name: "true scene", label, poses: true_ } : null };
}

// The arrays with the difference [m] to the observed depth, NaN where either is missing. Null until that is there.
/** @type {(arrays: Arrays | null, region: number[] | null) => Arrays | null} */
function withObserved(arrays, region) {
  const depth = observedDepth();
  if (!arrays || !depth) return null;
  if (!arrays.difference) {
    const [u0, v0, w] = region;
    const at = (/** @type {number} */ i) => (v0 + Math.floor(i / w)) * state.frame.camera.w + u0 + (i % w);
    arrays.difference = arrays.rendered.map((rendered, i) => {
      const observed = depth[at(i)];
      return observed > 0 && rendered > 0 ? observed - rendered : NaN;
    });
  }
  return arrays;
}

// A pose with its maps. While they are on their way those of the pose shown before stand for them, `stale`.
/** @type {Record<string, Pick<MapsAnswer, "region" | "score" | "scale"> & { place: string, arrays: Arrays }>} */
const shown = {}; // by letter, the maps that came last
/** @type {(moment: Moment, pose: NamedPose | null, letter: string) => Side | null} */
function sideOf(moment, pose, letter) {
  if (!pose?.T && !pose?.poses) return null;
  const answer = want(mapsOf(moment, pose), pose.name === "edited" ? "edited" : `maps-${letter}`);
  const arrays = withObserved(arraysOf(answer), answer && "region" in answer ? answer.region : null);
  const place = `${state.frame.id} ${pose.poses ? "all" : moment.obj}`;
  if (arrays && "region" in answer) {
    const { region, score, scale } = answer;
    shown[letter] = { place, region, score, scale, arrays };
    return { ...shown[letter], pose, letter, stale: false, gone: null };
  }
  const gone = answer && "gone" in answer ? answer.gone : null;
  const before = shown[letter]?.place === place && !gone ? shown[letter] : null;
  return { ...before, pose, letter, stale: true, gone };
}

/** @type {WeakMap<Arrays, WeakMap<Arrays, Mapped>>} */
const gains = new WeakMap(); // arrays of A → arrays of B → gain
/** @type {(a: Mapped, b: Mapped) => Mapped} */
function gainBetween(a, b) {
  if (!gains.has(a.arrays)) gains.set(a.arrays, new WeakMap());
  const own = gains.get(a.arrays);
  if (!own.has(b.arrays)) own.set(b.arrays, gainOf(a, b));
  return own.get(b.arrays);
}

// { a, b, same, gain }: of equal poses a alone; sides without arrays have nothing to draw yet.
/** @type {Sides} */
const NO_SIDES = { a: null, b: null, same: false, gain: null };
/** @type {{ key: unknown[], sides?: Sides }} */
let last = { key: [] }; // cache: the sides, and what they follow from
/** @type {(moment: Moment | null) => Sides} */
export function sidesOf(moment) {
  if (!moment) return NO_SIDES;
  const pair = pairOf(moment);
  const a = sideOf(moment, pair.a, "a");
  const b = pair.same ? null : sideOf(moment, pair.b, "b");
  const key = [a?.arrays, b?.arrays, a?.pose, b?.pose, a?.stale, b?.stale, a?.gone, b?.gone];
  if (key.length !== last.key.length || key.some((x, i) => x !== last.key[i])) {
    const gain = a?.arrays && b?.arrays ? { ...gainBetween(/** @type {Mapped} */ (a), /** @type {Mapped} */ (b)), letter: "gain", stale: a.stale || b.stale } : null;
    last = { key, sides: { a, b, same: pair.same, gain } };
  }
  return last.sides;
}

/** @param {Sides} sides */
export const hasColour = (sides) => Boolean(sides.a?.arrays?.correlation || sides.b?.arrays?.correlation);

// The observed depth [m], 0 = none; and as a side of its own over the whole image, with the scale of another one.
/** @type {{ buffer: ArrayBuffer | null, depth?: Float32Array | null, side?: Mapped, whole?: Float32Array }} */
let observed = { buffer: null }; // cache
export function observedDepth() {
  const buffer = state.frame?.depth ? blob(state.frame.depth) : null;
  if (observed.buffer !== buffer) observed = { buffer, depth: buffer && new Float32Array(buffer) };
  return observed.depth ?? null;
}
/** @type {(like: Side | null) => Mapped | null} */
function observedSide(like) {
  const depth = observedDepth();
  const scale = like?.scale ?? (depth && !momentOf(state) ? wholeScale(depth) : null);
  if (!scale) return null;
  if (observed.side?.scale.depth.join() !== scale.depth.join()) {
    const { w, h } = state.frame.camera;
    observed.side = { region: [0, 0, w, h], arrays: { depth }, scale, letter: "observed" };
  }
  return observed.side;
}
// Of a frame without objects: from the nearest to the farthest but for a hundredth.
/** @type {(depth: Float32Array) => MapScale} */
function wholeScale(depth) {
  observed.whole ??= depth.filter((m) => m > 0).sort();
  const at = (/** @type {number} */ share) => observed.whole[Math.floor(share * (observed.whole.length - 1))] ?? share;
  return { depth: [at(0.01), at(0.99)], tau_mm: 1000 * state.frame.tau_m, colour_weight: 0 };
}
// The photo as the colour term sees it, as a side over the whole image.
/** @type {WeakMap<ArrayBuffer, Mapped>} */
const smoothed = new WeakMap(); // cache
/** @type {(sides: Sides) => Mapped | null} */
function smoothedSide(sides) {
  const buffer = hasColour(sides) ? blob(state.frame.smoothed) : null;
  if (buffer && !smoothed.has(buffer)) {
    const { w, h } = state.frame.camera;
    const { scale } = sides.a?.scale ? sides.a : sides.b;
    smoothed.set(buffer, { region: [0, 0, w, h], arrays: { observed_rgb: new Uint8Array(buffer) }, scale, letter: "observed" });
  }
  return (buffer && smoothed.get(buffer)) ?? null;
}
// Which arrays a map is drawn from: those of a side, or those that A and B share.
/** @type {(name: string, sides: Sides, letter?: string) => Mapped | null} */
export function sideFor(name, sides, letter) {
  if (name === "observed") return observedSide(sides.a?.scale ? sides.a : sides.b);
  if (name === "observed_rgb") return smoothedSide(sides);
  if (name === "gain") return sides.gain;
  const side = /** @type {Mapped | null} */ (sides[letter]?.arrays ? sides[letter] : null);
  return side && MAPS[name].of(side) ? side : null;
}

/** @type {(side: Mapped, u: number, v: number) => number} */
export function indexAt(side, u, v) {
  const [u0, v0, w, h] = side.region;
  return u >= u0 && v >= v0 && u < u0 + w && v < v0 + h ? (v - v0) * w + u - u0 : -1;
}
/** @type {(name: string, side: Mapped | null, pixel: [number, number] | null) => ReturnType<typeof valueAt>} */
export const readAt = (name, side, pixel) =>
  side && pixel ? valueAt(MAPS[name], side, indexAt(side, ...pixel)) : null;

// A map as a canvas of its region's size, drawn once.
const canvases = new WeakMap(); // arrays → { name: canvas }
/** @type {(name: string, side: Mapped) => HTMLCanvasElement} */
export function mapCanvas(name, side) {
  const own = canvases.get(side.arrays) ?? {};
  canvases.set(side.arrays, own);
  const key = name === "observed" || name === "rendered" ? `${name} ${side.scale.depth}` : name;
  if (!own[key]) {
    const [, , w, h] = side.region;
    const canvas = Object.assign(document.createElement("canvas"), { width: w, height: h });
    const image = new ImageData(w, h);
    paint(MAPS[name], side, new Uint32Array(image.data.buffer));
    canvas.getContext("2d").putImageData(image, 0, 0);
    own[key] = canvas;
  }
  return own[key];
}

// Pictures by address, decoded once.
const MOST_PICTURES = 40;
/** @type {Map<string, HTMLImageElement>} */
const pictures = new Map();
/** @type {(url: string, gone?: () => void) => HTMLImageElement | null} */
function picture(url, gone) {
  if (!pictures.has(url)) {
    const image = new Image();
    image.onload = changed;
    image.onerror = () => {
      pictures.delete(url);
      gone?.();
    };
    image.src = url;
    pictures.set(url, image);
    if (pictures.size > MOST_PICTURES) pictures.delete(pictures.keys().next().value);
  }
  const image = pictures.get(url);
  return image.complete && image.naturalWidth ? image : null;
}

export const photo = () => (state.frame?.rgb ? picture(addressOf(`/blob/${state.frame.rgb}`)) : null);
const colours = new WeakMap();
export function colourAt([u, v]) {
  const image = photo();
  if (!image) return null;
  if (!colours.has(image)) {
    const { naturalWidth: width, naturalHeight: height } = image;
    const canvas = Object.assign(document.createElement("canvas"), { width, height });
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    colours.set(image, context.getImageData(0, 0, width, height).data);
  }
  const i = 4 * (v * image.naturalWidth + u);
  return [...colours.get(image).subarray(i, i + 3)];
}

// The shaded model at a pose: { region, image } or null until it is there.
/** @type {(obj: number, T: Pose, slot: string) => { region: number[], image: HTMLImageElement } | null} */
export function shadedOf(obj, T, slot) {
  const answer = want({ what: "shaded", obj, T }, slot);
  if (!answer || "gone" in answer || !answer.url) return null;
  const image = picture(addressOf(answer.url), () => forget(answer));
  return image && { region: answer.region, image };
}
