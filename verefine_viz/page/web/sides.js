// The two poses that are compared, A and B, with their maps; canvases and pictures that are drawn from them.
import { state, want, forget, arraysOf, blob, changed, addressOf } from "./store.js";
import { MAPS, gainOf, paint, valueAt } from "./colours.js";

// Poses

// A pose is scored alike at all iterations between two changes of the score's settings: the first stands for all.
function scoredAt(branch, k) {
  const { scored = [] } = state.branches.find((b) => b.index === branch) ?? {};
  return 1 + (scored.findLast((after) => after < Math.max(k, 1)) ?? 0);
}

const wanted = new WeakMap(); // pose → want
export function wantOfMaps(moment, pose) {
  if (wanted.has(pose)) return wanted.get(pose);
  const branch = pose.branch ?? moment.branch;
  const k = scoredAt(branch, pose.k ?? moment.k);
  const posed = pose.poses ? { obj: null, poses: pose.poses } : { obj: moment.obj, T: pose.T };
  wanted.set(pose, { what: "maps", branch, k, ...posed });
  return wanted.get(pose);
}

// What is compared: poses of the object, or with `together` all objects as they stand and as they truly are; one whose
// ground truth is unknown stays where it is, so that both scenes have the same objects.
const pairs = new WeakMap(); // moment → pair
function pairOf(moment) {
  if (!state.view.together || moment.scene.length < 2) return moment;
  if (!pairs.has(moment)) pairs.set(moment, wholeScene(moment));
  return pairs.get(moment);
}
function wholeScene(moment) {
  const posed = (of) => moment.scene.map((o) => [o.object.id, of(o)]).filter(([, T]) => T);
  const known = moment.scene.filter((o) => o.object.gt).length;
  const [stands, true_] = [posed((o) => o.T), known ? posed((o) => o.object.gt ?? o.T) : []];
  const label = known < moment.scene.length ? "ground truth where known" : "ground truth";
  return { a: stands.length ? { name: "scene", label: "as they stand", poses: stands } : null, same: false,
    b: true_.length ? { name: "true scene", label, poses: true_ } : null };
}

// The arrays with those that the images of the frame give: the depth difference [m], NaN where either depth is missing,
// and where colour counts the observed one. Null until these images are there.
function withObserved(arrays, region) {
  const depth = observedDepth();
  const smoothed = arrays?.correlation && blob(state.frame.smoothed);
  if (!arrays || !depth || smoothed === null) return null;
  if (!arrays.difference) {
    const [u0, v0, w] = region;
    const at = (i) => (v0 + Math.floor(i / w)) * state.frame.camera.w + u0 + (i % w);
    arrays.difference = arrays.rendered.map((rendered, i) => {
      const observed = depth[at(i)];
      return observed > 0 && rendered > 0 ? observed - rendered : NaN;
    });
    if (smoothed) {
      const image = new Uint8Array(smoothed);
      arrays.observed_rgb = arrays.rendered_rgb.map((_, i) => image[3 * at(Math.floor(i / 3)) + (i % 3)]);
    }
  }
  return arrays;
}

// A pose with its maps. While they are on their way those of the pose shown before stand for them, `stale`.
const shown = {}; // by letter, the maps that came last
function sideOf(moment, pose, letter) {
  if (!pose?.T && !pose?.poses) return null;
  const answer = want(wantOfMaps(moment, pose), pose.name === "edited" ? "edited" : `maps-${letter}`);
  const arrays = withObserved(arraysOf(answer), answer?.region);
  const place = `${state.frame.id} ${pose.poses ? "all" : moment.obj}`;
  if (arrays) {
    const { region, score, scale } = answer;
    shown[letter] = { place, region, score, scale, arrays };
    return { ...shown[letter], pose, letter, stale: false, gone: null };
  }
  const before = shown[letter]?.place === place && !answer?.gone ? shown[letter] : null;
  return { ...before, pose, letter, stale: true, gone: answer?.gone ?? null };
}

const gains = new WeakMap(); // arrays of A → arrays of B → gain
function gainBetween(a, b) {
  if (!gains.has(a.arrays)) gains.set(a.arrays, new WeakMap());
  const own = gains.get(a.arrays);
  if (!own.has(b.arrays)) own.set(b.arrays, gainOf(a, b));
  return own.get(b.arrays);
}

// { a, b, same, gain }: of equal poses a alone; sides without arrays have nothing to draw yet.
const NO_SIDES = { a: null, b: null, same: false, gain: null };
let last = { key: [] };
export function sidesOf(moment) {
  if (!moment) return NO_SIDES;
  const pair = pairOf(moment);
  const a = sideOf(moment, pair.a, "a");
  const b = pair.same ? null : sideOf(moment, pair.b, "b");
  const key = [a?.arrays, b?.arrays, a?.pose, b?.pose, a?.stale, b?.stale, a?.gone, b?.gone];
  if (key.length !== last.key.length || key.some((x, i) => x !== last.key[i])) {
    const gain = a?.arrays && b?.arrays ? { ...gainBetween(a, b), letter: "gain", stale: a.stale || b.stale } : null;
    last = { key, sides: { a, b, same: pair.same, gain } };
  }
  return last.sides;
}

export const hasColour = (sides) => Boolean(sides.a?.arrays?.correlation || sides.b?.arrays?.correlation);

// The observed depth [m], 0 = none; and as a side of its own over the whole image, with the scale of another one.
let observed = { buffer: null };
export function observedDepth() {
  const buffer = state.frame?.depth ? blob(state.frame.depth) : null;
  if (observed.buffer !== buffer) observed = { buffer, depth: buffer && new Float32Array(buffer) };
  return observed.depth ?? null;
}
function observedSide(like) {
  const depth = observedDepth();
  if (!depth || !like?.scale) return null;
  if (observed.side?.scale.depth.join() !== like.scale.depth.join()) {
    const { w, h } = state.frame.camera;
    observed.side = { region: [0, 0, w, h], arrays: { depth }, scale: like.scale, letter: "observed" };
  }
  return observed.side;
}
// Which arrays a map is drawn from: those of a side, or those that A and B share.
export function sideFor(name, sides, letter) {
  if (name === "observed") return observedSide(sides.a?.scale ? sides.a : sides.b);
  if (name === "gain") return sides.gain;
  const side = sides[letter]?.arrays ? sides[letter] : null;
  return side && MAPS[name].of(side) ? side : null;
}

export function indexAt(side, u, v) {
  const [u0, v0, w, h] = side.region;
  return u >= u0 && v >= v0 && u < u0 + w && v < v0 + h ? (v - v0) * w + u - u0 : -1;
}
export const readAt = (name, side, pixel) =>
  side && pixel ? valueAt(MAPS[name], side, indexAt(side, ...pixel)) : null;

// A map as a canvas of its region's size, drawn once.
const canvases = new WeakMap(); // arrays → { name: canvas }
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
const pictures = new Map();
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
export function shadedOf(obj, T, slot) {
  const answer = want({ what: "shaded", obj, T }, slot);
  const image = answer?.url ? picture(addressOf(answer.url), () => forget(answer)) : null;
  return image && { region: answer.region, image };
}
