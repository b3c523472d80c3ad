// What the image pane draws: photo or depth, a map or the shaded model over it, outlines of poses, ruler and crosses.
import { state } from "./store.js";
import { labelOf, samePose, rampColor, ranksOf, STAGE_COLORS } from "./moment.js";
import { sideFor, mapCanvas, photo, shadedOf, observedDepth } from "./sides.js";
import { outlineOf, askOutlines, collect, pathOf } from "./outlines.js";
import { distance, origin, pointAt, project } from "./pose.js";

const SIDE_COLORS = { A: "#00becd", B: "#cdff46" }; // of two runs: core/palette.py

// Outlines of the moment: [{ key, label, color, items: [{ obj, T }], dashed }]; later ones are drawn over earlier ones.
export function contoursOf(moment) {
  const { object, obj } = moment;
  const poses = posesOf(moment)
    .map((one) => ({ color: STAGE_COLORS[one.key] ?? "#a0a0a0", ...one, items: [{ obj, T: one.T }] }));
  const others = moment.scene.filter((o) => o.object.id !== obj && o.T)
    .map((o) => ({ obj: o.object.id, T: o.T, color: o.object.color }));
  const last = Math.max(moment.arms.length - 1, 1);
  const shade = (j) => rampColor(1 - ranksOf(moment)[j] / last, "dark"); // pictures are dark in both themes
  const arms = moment.arms.map(({ T }, j) => ({ obj, T, color: shade(j) })).filter(({ T }) => T);
  const contours = [];
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
  return [...contours, ...poses];
}

// Poses of the object that are outlined, each once with all its names: ground truth, what is shown, A, B, the best.
function posesOf(moment) {
  const { poses } = moment;
  const named = [];
  const add = (key, more = {}) =>
    poses[key] && named.push({ key, label: labelOf(key, moment), T: poses[key].T, ...more });
  const letters = [["A", moment.a], ["B", moment.same ? null : moment.b]].filter(([, pose]) => pose?.T);
  const isLettered = (key) => letters.some(([, pose]) => pose.name === key && pose.branch == null);
  for (const key of ["ground truth", moment.stage ?? (poses.accepted ? "accepted" : "current")]) {
    if (!isLettered(key)) add(key);
  }
  for (const [letter, pose] of letters) {
    const dashed = letter === "B";
    if (pose.branch == null) add(pose.name, { label: `${letter} ${labelOf(pose.name, moment)}`, dashed });
    else named.push({ key: letter, label: pose.label, T: pose.T, color: SIDE_COLORS[letter], dashed });
  }
  if (!isLettered("best")) add("best");
  const also = moment.isAnswer ? moment.verdict?.also_fits : null;
  const color = STAGE_COLORS["runner-up"];
  if (also) named.push({ key: "also fits", label: "fits as well", T: also, color, dashed: true });
  // The same pose once: a later outline would hide the earlier one.
  const merged = [];
  for (const one of named) {
    const at = merged.findIndex((other) => samePose(other.T, one.T));
    const [before] = at < 0 ? [] : merged.splice(at, 1);
    const isPlain = !before || before.label === "accepted"; // which of its stages it is says more
    merged.push(isPlain ? one : { ...one, label: `${before.label} = ${one.label}` });
  }
  return merged;
}

export function draw(canvas, size, place, moment, sides, layers) {
  const ratio = canvas.width / size.w;
  const context = canvas.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.setTransform(ratio * place.scale, 0, 0, ratio * place.scale, ratio * place.x, ratio * place.y);
  const px = 1 / place.scale; // a pixel of the screen
  const { camera } = state.frame;
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
    if (layers.blink) drawOver(context, "shaded", sides, letter, 1, moment);
  } else if (!wiped) drawOver(context, over, sides, letter, layers.opacity, moment);
  else if (layers.wipe === "photo") clipped(layers.at, 1, () => drawOver(context, over, sides, letter, 1, moment));
  else {
    clipped(0, layers.at, () => drawOver(context, over, sides, "a", 1, moment));
    clipped(layers.at, 1, () => drawOver(context, over, sides, "b", 1, moment));
  }

  if (!blinks) drawContours(context, contoursOf(moment).filter((one) => !layers.hidden.includes(one.key)), px);
  if (wiped && !blinks) {
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const x = layers.at * size.w;
    stroke(context, () => line(context, x, 0, x, size.h), "#ffffff", 1.5, 1);
    context.setTransform(ratio * place.scale, 0, 0, ratio * place.scale, ratio * place.x, ratio * place.y);
  }
  drawRuler(context, state.view.ruler, px);
  drawCross(context, state.hover, px, { color: "#ffffff", reach: 9 * px });
  drawCross(context, state.view.pixel, px, { color: "#ffd23c", reach: 1e5 });
}

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

// Polygons of what an edited pose looked like before its own outline comes: moved and scaled with its origin.
let edited = null; // { obj, T, path }
function editedPath(obj, T) {
  if (edited?.obj !== obj) return null;
  const { K } = state.frame.camera;
  const [from, to, scale] = [project(origin(edited.T), K), project(origin(T), K), edited.T[11] / T[11]];
  const path = new Path2D();
  const shift = [0, 1].map((i) => to[i] + 0.5 - scale * (from[i] + 0.5));
  path.addPath(edited.path, new DOMMatrix([scale, 0, 0, scale, ...shift]));
  return path;
}

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
      if (path) strokePath(context, path, item.color ?? one.color, (one.thin ? 1.1 : 1.8) * px, px, dash);
    }
  }
  if (missing.length) askOutlines(missing);
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
