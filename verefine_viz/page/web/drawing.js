// What the image pane draws: photo or depth, a map or the shaded model over it, outlines of poses, ruler and crosses.
import { blob, state } from "./store.js";
import { armColor, isLabelled, labelOf, momentOf, samePose } from "./moment.js";
import { palette, stageColor } from "./palette.js";
import { sideFor, mapCanvas, photo, shadedOf, observedDepth } from "./sides.js";
import { outlineOf, askOutlines, collect, pathOf } from "./outlines.js";
import { endOf } from "./wants.js";
import { contoursOfDoubt, shownDoubt } from "./doubts.js";
import { allowedOf, axesOf, isChosenBySense, isDrawn } from "./drawn_unasked.js";
import { boxOf } from "./labelling.js";
import { distance, origin, pointAt, project } from "./pose.js";

/** @import { FrameMessage, Pose } from "./messages.d.ts" */
/** @import { Moment, NamedPose } from "./moment.js" */
/** @import { Sides } from "./sides.js" */
/** @import { Layers } from "./store.js" */
/** @typedef {CanvasRenderingContext2D} Context */

/**
 * Outlines of the moment: [{ key, label, color, items: [{ obj, T }], dashed }]; later ones are drawn over earlier ones.
 * @param {Moment} moment
 */
export function contoursOf(moment) {
  const { object, obj } = moment;
  const colorOf = (/** @type {string} */ key) => (key === "current" && isLabelled(state.frame) ? object.color : stageColor(key));
  const poses = posesOf(moment)
    .map((one) => ({ color: colorOf(one.key), ...one, items: [{ obj, T: one.T }] }));
  const others = moment.scene.filter((o) => o.object.id !== obj && o.T)
    .map((o) => ({ obj: o.object.id, T: o.T, color: o.object.color }));
  const shade = (/** @type {number} */ j) => armColor(moment, j, "dark"); // pictures are dark in both themes
  const arms = moment.arms.map(({ T }, j) => ({ obj, T, color: shade(j) })).filter(({ T }) => T);
  const contours = [];
  if (state.frame.support) {
    contours.push({ key: "plane", label: "support plane", color: palette.scene.plane, polygons: [state.frame.support.outline], items: [] });
  }
  if (object.mask?.length) {
    contours.push({ key: "mask", label: "mask", color: object.color, polygons: object.mask, items: [] });
  }
  if (others.length) {
    contours.push({ key: "others", label: "other objects", color: others[0].color, items: others, thin: true });
  }
  if (arms.length > 1) {
    const label = `${arms.length} hypotheses`;
    contours.push({ key: "hypotheses", label, color: shade(moment.arm), items: arms, thin: true });
  }
  const allowed = allowedOf(moment);
  if (allowed) {
    const items = allowed.poses.map((T) => ({ obj, T }));
    contours.push({ key: "allowed", label: "allowed by the image", hint: allowed.words, color: palette.scene.allowed, items, faint: true });
  }
  const axes = axesOf(moment);
  if (axes.length) poses.push(/** @type {any} */ ({ key: "axes", label: "axes", color: palette.axes[0], items: [], axes }));
  const end = endOf(state, moment);
  const ends = end ? [{ key: "end", label: "refined from here", color: stageColor("refined"), items: [{ obj, T: end.T }], dashed: true }] : [];
  return [...contours, ...poses, ...ends];
}

/** @type {(moment: Moment, layers: Layers, key: string) => boolean} */
export const isOutlined = (moment, layers, key) => (isChosenBySense(key) ? isDrawn(state, moment, key) : !layers.hidden.includes(key));

/**
 * Poses of the object that are outlined, each once with all its names: ground truth, what is shown, A, B, the best.
 * @param {Moment} moment
 */
function posesOf(moment) {
  const { poses } = moment;
  const named = [];
  const add = (key, more = {}) =>
    poses[key] && named.push({ key, label: labelOf(key, moment), T: poses[key].T, ...more });
  /** @type {["A" | "B", NamedPose][]} */
  const sides = [["A", moment.a], ["B", moment.same ? null : moment.b]];
  const letters = sides.filter(([, pose]) => pose?.T);
  /** @param {string} key */
  const isLettered = (key) => letters.some(([, pose]) => pose.name === key && pose.branch == null);
  for (const key of ["ground truth", moment.stage ?? (poses.accepted ? "accepted" : "current")]) {
    if (!isLettered(key)) add(key);
  }
  for (const [letter, pose] of letters) {
    const dashed = letter === "B";
    if (pose.branch == null) add(pose.name, { letter, dashed });
    else named.push({ key: letter, label: pose.label, T: pose.T, color: palette.sides[letter], dashed });
  }
  if (!isLettered("best")) add("best");
  const also = moment.isAnswer ? moment.verdict?.also_fits : null;
  if (also) named.push({ key: "also fits", label: "fits as well", T: also, color: palette.scene.allowed, dashed: true });
  // The same pose once: a later outline would hide the earlier one.
  const merged = [];
  for (const one of named) {
    const at = merged.findIndex((other) => samePose(other.T, one.T));
    const [before] = at < 0 ? [] : merged.splice(at, 1);
    const isPlain = !before || before.label === "accepted"; // which of its stages it is says more
    merged.push(isPlain ? one : { ...one, label: `${before.label} = ${one.label}`, letter: before.letter ?? one.letter });
  }
  return merged;
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {{ w: number, h: number }} size
 * @param {{ scale: number, x: number, y: number }} place
 * @param {Moment | null} moment  null = the frame has no object
 * @param {Sides} sides
 * @param {Layers} layers
 */
export function draw(canvas, size, place, moment, sides, layers) {
  const ratio = canvas.width / size.w;
  const context = canvas.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.setTransform(ratio * place.scale, 0, 0, ratio * place.scale, ratio * place.x, ratio * place.y);
  const px = 1 / place.scale; // a pixel of the screen
  const { camera } = state.frame;
  const doubt = shownDoubt(state);
  if (doubt) layers = { ...layers, over: "none", wipe: "off", blink: null, under: doubt.picture === "depth" ? "depth" : layers.under };
  const over = layers.over === "none" && layers.wipe !== "off" ? "shaded" : layers.over;
  const wiped = layers.wipe !== "off";
  const blinks = layers.blink != null;

  drawUnder(context, layers, sides, camera, place.scale);
  const clipped = (from, to, work) => {
    context.save();
    const [left, right] = [from, to].map((share) => (share * size.w - place.x) / place.scale);
    context.beginPath();
    context.rect(left, -1e5, right - left, 2e5);
    context.clip();
    work();
    context.restore();
  };
  const letter = sides.b && layers.side === "b" ? "b" : "a";
  if (blinks) {
    if (layers.blink !== "photo") drawOver(context, "shaded", sides, layers.blink, 1, moment);
  } else if (!wiped) drawOver(context, over, sides, letter, layers.opacity, moment);
  else if (layers.wipe === "photo") clipped(layers.at, 1, () => drawOver(context, over, sides, letter, 1, moment));
  else {
    clipped(0, layers.at, () => drawOver(context, over, sides, "a", 1, moment));
    clipped(layers.at, 1, () => drawOver(context, over, sides, "b", 1, moment));
  }

  if (!blinks && !doubt && !layers.hidden.includes("plane")) drawOnPlane(context);
  if (doubt) drawDoubt(context, px);
  else if (!blinks && moment) drawContours(context, contoursOf(moment).filter((one) => isOutlined(moment, layers, one.key)), px);
  if (wiped && !blinks) {
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const x = layers.at * size.w;
    stroke(context, () => line(context, x, 0, x, size.h), "#ffffff", 1.5, 1);
    context.setTransform(ratio * place.scale, 0, 0, ratio * place.scale, ratio * place.x, ratio * place.y);
  }
  drawSketch(context, state.sketch, px);
  drawRuler(context, state.view.ruler, px);
  drawCross(context, state.hover, px, { color: "#ffffff", reach: 9 * px });
  drawCross(context, state.view.pixel, px, { color: "#ffd23c", reach: 1e5 });
}

/** @type {(context: Context, layers: Layers, sides: Sides, camera: FrameMessage["camera"], scale: number) => void} */
function drawUnder(context, layers, sides, camera, scale) {
  const image = photo();
  const depth = layers.under === "depth" || !state.frame.rgb ? sideFor("observed", sides) : null;
  context.fillStyle = "#101114";
  context.fillRect(0, 0, camera.w, camera.h);
  context.imageSmoothingEnabled = scale < 3;
  if (depth) context.drawImage(mapCanvas("observed", depth), 0, 0);
  else if (image) context.drawImage(image, 0, 0, camera.w, camera.h);
}

function drawOver(context, over, sides, letter, opacity, moment) {
  if (over === "none") return;
  context.globalAlpha = opacity;
  if (over === "shaded") {
    const pose = sides[letter]?.pose;
    const posed = pose ? (pose.poses ?? [[moment.obj, pose.T]]) : [];
    context.imageSmoothingEnabled = true;
    for (const [obj, T] of [...posed].sort((x, y) => y[1][11] - x[1][11])) {
      const one = shadedOf(obj, T, `shaded ${letter} ${obj}`);
      if (one) context.drawImage(one.image, ...one.region);
    }
  } else {
    const side = sideFor(over, sides, letter);
    if (side) {
      context.imageSmoothingEnabled = false;
      const canvas = mapCanvas(over, side);
      context.drawImage(canvas, ...side.region);
    }
  }
  context.globalAlpha = 1;
}

// Pixels of the background that lie on the support plane, tinted.
const ON_PLANE = 0.45;
/** @type {WeakMap<ArrayBuffer, HTMLCanvasElement>} */
const tinted = new WeakMap(); // blob → its picture
function drawOnPlane(context) {
  const inliers = state.frame.support && blob(state.frame.support.inliers);
  if (!inliers) return;
  if (!tinted.has(inliers)) tinted.set(inliers, tintedPixels(new Uint8Array(inliers), state.frame.camera));
  context.globalAlpha = ON_PLANE;
  context.drawImage(tinted.get(inliers), 0, 0);
  context.globalAlpha = 1;
}
function tintedPixels(pixels, { w, h }) {
  const canvas = Object.assign(document.createElement("canvas"), { width: w, height: h });
  const picture = new ImageData(w, h);
  const color = palette.scene.plane.match(/\w\w/g).map((x) => parseInt(x, 16));
  pixels.forEach((on, i) => on && picture.data.set([...color, 255], 4 * i));
  canvas.getContext("2d").putImageData(picture, 0, 0);
  return canvas;
}

// Polygons of what an edited pose looked like before its own outline comes: moved and scaled with its origin.
/** @type {{ obj: number, T: Pose, path: Path2D } | null} */
let edited = null; // cache: { obj, T, path }
/** @type {(obj: number, T: Pose) => Path2D | null} */
function editedPath(obj, T) {
  if (edited?.obj !== obj) return null;
  const { K } = state.frame.camera;
  const [from, to, scale] = [project(origin(edited.T), K), project(origin(T), K), edited.T[11] / T[11]];
  const path = new Path2D();
  const shift = [0, 1].map((i) => to[i] + 0.5 - scale * (from[i] + 0.5));
  path.addPath(edited.path, new DOMMatrix([scale, 0, 0, scale, ...shift]));
  return path;
}

const FAINT = 0.75; // of outlines that lie over each other
function drawContours(context, contours, px) {
  collect();
  const missing = [];
  context.lineJoin = "round";
  for (const one of contours) {
    if (one.polygons) strokePath(context, pathOf(one.polygons), one.color, 1.2 * px, px, [2 * px, 2 * px]);
    for (const item of one.items) {
      let path = outlineOf(item.obj, item.T, missing);
      if (one.key === "edited") {
        if (path) edited = { ...item, path };
        else path = editedPath(item.obj, item.T);
      }
      const dash = one.dashed ? [6 * px, 4 * px] : [];
      context.globalAlpha = one.faint ? FAINT : 1;
      if (path) strokePath(context, path, item.color ?? one.color, (one.faint ? 0.9 : one.thin ? 1.1 : 1.8) * px, one.faint ? 0 : px, dash);
      context.globalAlpha = 1;
    }
    if (one.axes) drawAxes(context, one.axes, px);
    // What turns behind the object shows in no outline: the axes say how far.
    if (one.faint) for (const { T } of one.items) drawFaintAxes(context, T, px);
  }
  if (missing.length) askOutlines(missing);
}

// The axes of a pose as lines in the image: [{ color, path, end }].
const AXIS_RADII = 1.1; // as in 3D
const BUTTONS_PX = 46; // at the top of the pane, over the picture
function axisLines(T) {
  const { K } = state.frame.camera;
  const length = AXIS_RADII * (momentOf(state).object.diameter_mm / 2000);
  const at = (point) => project(point, K).map((x) => x + 0.5);
  const from = at(origin(T));
  return palette.axes.map((color, i) => {
    const end = at([3, 7, 11].map((j) => T[j] + length * T[j - 3 + i]));
    const path = new Path2D();
    path.moveTo(from[0], from[1]);
    path.lineTo(end[0], end[1]);
    return { color, path, end };
  });
}

function drawFaintAxes(context, T, px) {
  context.globalAlpha = FAINT;
  context.lineWidth = 1.1 * px;
  for (const { color, path } of axisLines(T)) {
    context.strokeStyle = color;
    context.stroke(path);
  }
  context.globalAlpha = 1;
}

// Those of A solid, those of B dashed, with their names at their ends; a name that would lie on another stands below it.
/** @type {(context: Context, axes: [string, Pose][], px: number) => void} */
function drawAxes(context, axes, px) {
  const all = axes.flatMap(([letter, T]) => axisLines(T).map((one, i) => ({ ...one, letter, name: `${"xyz"[i]}${letter}` })));
  for (const { color, path, letter } of all) {
    strokePath(context, path, color, (letter === "A" ? 3 : 2) * px, px, letter === "A" ? [] : [5 * px, 4 * px]);
  }
  context.font = `700 ${12 * px}px system-ui, sans-serif`;
  context.lineWidth = 3 * px;
  context.strokeStyle = "rgba(0, 0, 0, 0.7)";
  /** @type {number[][]} */
  const taken = [];
  const { d, f } = context.getTransform();
  for (const { color, end, name } of all) {
    const x = end[0] + 3 * px;
    let low = Math.max(end[1] + 4 * px, BUTTONS_PX * px - f / d);
    while (taken.some(([u, v]) => Math.abs(u - x) < 20 * px && Math.abs(v - low) < 13 * px)) low += 2 * px;
    taken.push([x, low]);
    context.strokeText(name, x, low);
    context.fillStyle = color;
    context.fillText(name, x, low);
  }
}

function drawDoubt(context, px) {
  for (const { path, color, wide, filled } of contoursOfDoubt()) {
    context.fillStyle = color;
    if (filled) context.fill(path, "evenodd");
    else strokePath(context, path, color, wide * px, px, []);
  }
}

function strokePath(context, path, color, width, px, dash) {
  context.setLineDash([]);
  context.strokeStyle = "rgba(0, 0, 0, 0.55)";
  context.lineWidth = width + 1.6 * px;
  context.stroke(path);
  context.setLineDash(dash);
  context.strokeStyle = color;
  context.lineWidth = width;
  context.stroke(path);
  context.setLineDash([]);
}

const line = (context, x0, y0, x1, y1) => {
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
};
// Once dark and wide, once in its colour: it shows on any ground.
function stroke(context, way, color, width, px) {
  for (const [style, wide] of [["rgba(0, 0, 0, 0.55)", width + 1.5 * px], [color, width]]) {
    context.strokeStyle = style;
    context.lineWidth = wide;
    context.beginPath();
    way();
    context.stroke();
  }
}

// A cross around a pixel that leaves the pixel itself free; px: a pixel of the screen in units of the drawing.
export function drawCross(context, pixel, px, { color, reach }) {
  if (!pixel) return;
  const [u, v] = [pixel[0] + 0.5, pixel[1] + 0.5];
  const free = Math.max(0.5, 3 * px);
  stroke(context, () => {
    line(context, u - reach, v, u - free, v);
    line(context, u + free, v, u + reach, v);
    line(context, u, v - reach, u, v - free);
    line(context, u, v + free, u, v + reach);
  }, color, px, px);
}

// A box or a scribble by which a model is placed.
/** @type {(context: Context, sketch: import("./labelling.js").Sketch | null, px: number) => void} */
function drawSketch(context, sketch, px) {
  if (!sketch || sketch.pixels.length < 2) return;
  const path = new Path2D();
  if (sketch.kind === "box") {
    const [left, top, right, bottom] = boxOf(sketch.pixels);
    path.rect(left, top, right - left, bottom - top);
  } else for (const [u, v] of sketch.pixels) path.lineTo(u + 0.5, v + 0.5);
  strokePath(context, path, "#ffd23c", (sketch.kind === "box" ? 1.5 : 4) * px, px, []);
}

function drawRuler(context, ruler, px) {
  if (!ruler) return;
  const [[u0, v0], [u1, v1]] = ruler;
  stroke(context, () => line(context, u0 + 0.5, v0 + 0.5, u1 + 0.5, v1 + 0.5), "#ffd23c", 1.5 * px, px);
  const text = rulerText(ruler);
  context.font = `600 ${12 * px}px system-ui, sans-serif`;
  const [x, y] = [(u0 + u1) / 2 + 8 * px, (v0 + v1) / 2 - 8 * px];
  const { width } = context.measureText(text);
  context.fillStyle = "rgba(0, 0, 0, 0.75)";
  context.fillRect(x - 4 * px, y - 13 * px, width + 8 * px, 18 * px);
  context.fillStyle = "#ffd23c";
  context.fillText(text, x, y);
}

export const depthAt = ([u, v]) => {
  const depth = observedDepth();
  return (depth && depth[v * state.frame.camera.w + u]) || null;
};
export function rulerText([from, to]) {
  const { K } = state.frame.camera;
  const [near, far] = [depthAt(from), depthAt(to)];
  if (!near || !far) return `${Math.hypot(to[0] - from[0], to[1] - from[1]).toFixed(0)} px, no depth`;
  const along = 1000 * (far - near);
  const length = 1000 * distance(pointAt(from, near, K), pointAt(to, far, K));
  return `${length.toFixed(1)} mm, depth ${along > 0 ? "+" : "−"}${Math.abs(along).toFixed(1)}`;
}
