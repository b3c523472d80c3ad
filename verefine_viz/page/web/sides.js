// The two poses that are compared, A and B, with their maps; canvases drawn from arrays; outlines of poses.
import { state, want, arraysOf, blob, changed } from "./store.js";
import { momentOf, runOf, rowsOf } from "./moment.js";
import { MAPS, gainOf, paint, valueAt } from "./colours.js";

const MOST_OUTLINES = 6000;
const CHUNK = 60; // poses in one want
const IDLE_MS = 120;

// Poses

export const wantOfMaps = (moment, pose) => ({ what: "maps", branch: pose.branch ?? moment.branch, k: pose.k ?? moment.k,
  ...(pose.poses ? { obj: null, poses: pose.poses } : { obj: moment.obj, T: pose.T }) });

// What is compared: poses of the object, or with `together` all objects as they stand and as they truly are.
const pairs = new WeakMap(); // moment → pair
function pairOf(moment) {
  if (!state.view.together || moment.scene.length < 2) return moment;
  if (!pairs.has(moment)) pairs.set(moment, wholeScene(moment));
  return pairs.get(moment);
}
function wholeScene(moment) {
  const posed = (of) => moment.scene.map((o) => [o.object.id, of(o)]).filter(([, T]) => T);
  const [stands, true_] = [posed((o) => o.T), posed((o) => o.object.gt)];
  return { a: stands.length ? { name: "scene", label: "as they stand", poses: stands } : null, same: false,
    b: true_.length ? { name: "true scene", label: "ground truth", poses: true_ } : null };
}

// A pose with its maps. While they are on their way those of the pose shown before stand for them, `stale`.
const shown = {}; // by letter, the maps that came last
function sideOf(moment, pose, letter) {
  if (!pose?.T && !pose?.poses) return null;
  const answer = want(wantOfMaps(moment, pose), pose.name === "edited" ? "edited" : `maps-${letter}`);
  const arrays = arraysOf(answer);
  const place = `${state.frame.id} ${pose.poses ? "all" : moment.obj}`;
  if (arrays) {
    const { region, score, scale } = answer;
    shown[letter] = { place, region, score, scale, arrays };
    return { ...shown[letter], pose, letter, stale: false, gone: null };
  }
  const before = shown[letter]?.place === place ? shown[letter] : null;
  return { ...before, pose, letter, stale: true, gone: answer?.gone ?? null };
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
    const gain = a?.arrays && b?.arrays ? { ...gainOf(a, b), letter: "gain", stale: a.stale || b.stale } : null;
    last = { key, sides: { a, b, same: pair.same, gain } };
  }
  return last.sides;
}

export const hasColour = (sides) => Boolean(sides.a?.arrays?.correlation || sides.b?.arrays?.correlation);

// The observed depth [m], 0 = none, and as a side of its own over the whole image; `like`: whose scale it is drawn with.
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
Object.assign(MAPS.observed, { of: (side) => side.arrays.depth, where: (side) => side.arrays.depth });

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
export const readAt = (name, side, pixel) => (side && pixel ? valueAt(MAPS[name], side, indexAt(side, ...pixel)) : null);

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
export function picture(url) {
  if (!pictures.has(url)) {
    const image = new Image();
    image.onload = () => changed();
    image.src = url;
    pictures.set(url, image);
    if (pictures.size > MOST_PICTURES) pictures.delete(pictures.keys().next().value);
  }
  const image = pictures.get(url);
  return image.complete && image.naturalWidth ? image : null;
}

export const photo = () => (state.frame?.rgb ? picture(`/blob/${state.frame.rgb}`) : null);
const colours = new WeakMap();
export function colourAt([u, v]) {
  const image = photo();
  if (!image) return null;
  if (!colours.has(image)) {
    const canvas = Object.assign(document.createElement("canvas"), { width: image.naturalWidth, height: image.naturalHeight });
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    colours.set(image, context.getImageData(0, 0, canvas.width, canvas.height).data);
  }
  const i = 4 * (v * image.naturalWidth + u);
  return [...colours.get(image).subarray(i, i + 3)];
}

// The shaded model at a pose: { region, image } or null until it is there.
export function shadedOf(obj, T, slot) {
  const answer = want({ what: "shaded", obj, T }, slot);
  const image = answer?.url ? picture(answer.url) : null;
  return image && { region: answer.region, image };
}

// Outlines, by object and pose. Those that a picture needs are asked for together; those of a run before they are needed.

const outlines = new Map(); // key → Path2D in pixels of the image, where pixel u covers u … u + 1
const under = []; // wants that are on their way: { obj, poses, slot }
const keyOf = (obj, T) => `${state.frame.id} ${obj} ${T.join()}`;

export function outlineOf(obj, T, missing) {
  const key = keyOf(obj, T);
  const known = outlines.get(key);
  if (known) return known;
  if (missing) missing.push({ obj, T });
  return null;
}

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

function ask(one) {
  const at = under.findIndex((other) => other.slot === one.slot);
  if (at >= 0) under.splice(at, 1);
  under.push(one);
  collect();
}

// Moves answers that came into the table; called before each drawing.
export function collect() {
  for (const one of [...under]) {
    const answer = want({ what: "outlines", obj: one.obj, poses: one.poses }, one.slot);
    if (!answer) continue;
    under.splice(under.indexOf(one), 1);
    (answer.outlines ?? []).forEach((polygons, i) => outlines.set(keyOf(one.obj, one.poses[i]), pathOf(polygons)));
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
  for (const arm of moment.object.arms) add(arm.T);
  for (const row of rowsOf(runOf(state), moment.obj)) {
    for (const stage of row.stages) add(stage.T);
    add(row.best?.T);
    if (poses.size >= CHUNK) break;
  }
  if (poses.size) ask({ obj: moment.obj, poses: [...poses.values()].slice(0, CHUNK), slot: `ahead ${moment.obj}` });
  else if (state.running.branch == null) neighbours(moment);
}

function neighbours(moment) {
  for (const by of [1, -1]) {
    const k = moment.k + by;
    if (k < 0 || k > moment.run.rows.length) continue;
    const near = momentOf({ ...state, view: { ...state.view, k, stage: null } });
    if (near?.obj !== moment.obj) continue;
    for (const [letter, pose] of [["a", near.a], ["b", near.b]]) {
      if (pose?.T) arraysOf(want(wantOfMaps(near, pose), `ahead ${letter} ${by}`));
    }
  }
}
