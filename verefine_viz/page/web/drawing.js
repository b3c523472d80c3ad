// What the image pane draws: photo or depth, a map or the shaded model over it, outlines of poses, ruler and crosses.
import { state } from "./store.js";
import { labelOf, samePose, rampColor, ranksOf, STAGE_COLORS } from "./moment.js";
import { sideFor, mapCanvas, photo, shadedOf, observedDepth, outlineOf, askOutlines, collect, pathOf } from "./sides.js";
import { distance, origin, pointAt, project } from "./pose.js";

// Outlines of the moment: [{ key, label, color, items: [{ obj, T }], dashed }]; later ones are drawn over earlier ones.
export function contoursOf(moment, sides) {
  const { poses, object } = moment;
  const letters = [[moment.a, "A"], [moment.same ? null : moment.b, "B"]].filter(([pose]) => pose?.T);
  const named = [];
  if (poses["ground truth"]) named.push({ key: "ground truth", label: "ground truth", T: object.gt });
  const stage = moment.stage ?? (poses.accepted ? "accepted" : poses.current ? "current" : null);
  if (stage && poses[stage]) named.push({ key: stage, label: labelOf(stage, moment), T: poses[stage].T });
  for (const [pose, letter] of letters) {
    const at = named.findIndex((one) => one.key === pose.name && samePose(one.T, pose.T));
    if (at >= 0) named.splice(at, 1);
    const label = pose.label?.startsWith(`${letter}:`) ? pose.label : `${letter} ${labelOf(pose.name, moment)}`;
    named.push({ key: pose.branch == null ? pose.name : letter, label, T: pose.T, dashed: letter === "B", beside: pose.branch != null && letter });
  }
  if (poses.best && !named.some((one) => one.key === "best")) named.push({ key: "best", label: labelOf("best", moment), T: poses.best.T });
  const also = moment.isAnswer ? moment.verdict?.also_fits : null;
  if (also) named.push({ key: "also fits", label: "fits as well", T: also, color: STAGE_COLORS["runner-up"], dashed: true });
  // The same pose once, with all its names: a later outline would hide the earlier one.
  const merged = [];
  for (const one of named) {
    const at = merged.findIndex((other) => samePose(other.T, one.T));
    if (at < 0) merged.push(one);
    else {
      const [before] = merged.splice(at, 1);
      merged.push({ ...one, label: before.label === "accepted" ? one.label : `${before.label} = ${one.label}` });
    }
  }
  const beside = { A: "#00becd", B: "#cdff46" };
  const own = merged.map((one) => ({ ...one, color: one.color ?? beside[one.beside] ?? STAGE_COLORS[one.key] ?? "#a0a0a0",
    items: [{ obj: moment.obj, T: one.T }] }));
  const others = moment.scene.filter((o) => o.object.id !== moment.obj && o.T)
    .map((o) => ({ obj: o.object.id, T: o.T, color: o.object.color }));
  const arms = moment.arms.map((arm, j) => ({ obj: moment.obj, T: arm.T, color: rampColor(1 - ranksOf(moment)[j] / Math.max(moment.arms.length - 1, 1), "dark") })).filter((arm) => arm.T);
  return [
    object.mask?.length && { key: "mask", label: "mask", color: object.color, polygons: object.mask, items: [] },
    others.length && { key: "others", label: "other objects", color: others[0].color, items: others, thin: true },
    arms.length > 1 && { key: "hypotheses", label: `${arms.length} hypotheses`, color: arms[moment.arm]?.color, items: arms, thin: true },
    ...own,
  ].filter(Boolean);
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

  if (!blinks) drawContours(context, contoursOf(moment, sides).filter((one) => !layers.hidden.includes(one.key)), px);
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
  path.addPath(edited.path, new DOMMatrix([scale, 0, 0, scale, to[0] + 0.5 - scale * (from[0] + 0.5), to[1] + 0.5 - scale * (from[1] + 0.5)]));
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
      if (path) strokePath(context, path, item.color ?? one.color, (one.thin ? 1.1 : 1.8) * px, px, one.dashed ? [6 * px, 4 * px] : []);
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
function rulerText([from, to]) {
  const { K } = state.frame.camera;
  const [near, far] = [depthAt(from), depthAt(to)];
  if (!near || !far) return `${Math.hypot(to[0] - from[0], to[1] - from[1]).toFixed(0)} px, no depth`;
  const along = 1000 * (far - near);
  return `${(1000 * distance(pointAt(from, near, K), pointAt(to, far, K))).toFixed(1)} mm, depth ${along > 0 ? "+" : ""}${along.toFixed(1)}`;
}
