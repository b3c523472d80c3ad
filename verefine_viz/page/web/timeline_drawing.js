// What the timeline draws: what there is to draw, worked out once for a run, where it lies, worked out once for a size.
import { rankShares, rowsOf, startsOf } from "./moment.js";
import { palette, rampColor } from "./palette.js";

/** @import { FrameMessage, IterationRow, ScoredStage } from "./messages.d.ts" */
/** @import { Run } from "./store.js" */

// Marks by tone: what they say, and their shapes.
export const TONES = {
  problem: { words: "problem", shape: "down" },
  rejected: { words: "simulated accepted", shape: "square" },
  flip: { words: "flip", shape: "cross" },
  edited: { words: "edited pose", shape: "circle" },
  switched: { words: "hypothesis switched", shape: "bar" },
  best: { words: "new best", shape: "up" },
};
// In a square from −5 to 5.
export const SHAPES = {
  down: "M-5-4h10L0 5z", up: "M-4 3.5h8L0-4z", square: "M-4-4h8v8h-8z", circle: "M0-4.5a4.5 4.5 0 1 0 .01 0z",
    bar: "M-1.5-5h3v10h-3z",
  cross: "M-5-3 -3-5 0-2 3-5 5-3 2 0 5 3 3 5 0 2 -3 5 -5 3 -2 0z",
};

/**
 * Numbers to shares of the ramp, good = 1: the run's lowest and highest score or error are its ends.
 * @param {Run} run
 * @param {string} by
 */
export function scaleOf({ rows }, by) {
  /** @param {{ err?: number | null, score?: number | null } | undefined} s */
  const of = (s) => (by === "error" ? s?.err : s?.score);
  const known = rows.map((row) => of(row.stages.find((s) => s.name === row.accepted))).filter((x) => x != null);
  const low = Math.min(...known);
  const span = Math.max(...known) - low || 1;
  return (/** @type {Parameters<typeof of>[0]} */ pose) => {
    const value = of(pose);
    if (value == null || !known.length) return 0.5;
    return by === "error" ? 1 - (value - low) / span : (value - low) / span;
  };
}

/**
 * @param {FrameMessage} frame
 * @param {Run} runData
 * @param {number | null} obj
 * @param {string} by
 * @param {Set<string>} hidden
 * @param {number | null} arm
 */
export function modelOf(frame, runData, obj, by, hidden, arm) {
  const { rows, total } = runData;
  const objects = frame.objects.filter((o) => startsOf(runData, o).length);
  const several = objects.length > 1;
  const focus = obj ?? (several ? null : objects[0]?.id);
  /** @type {Map<number, IterationRow>} */
  const last = new Map();
  for (const row of rows) last.set(row.obj, row);
  const ranks = new Map(objects.map((o) => [o.id, rankShares(runData, o)]));
  const accepted = rows.map((row) => row.stages.find((s) => s.name === row.accepted));
  const scale = scaleOf(runData, by);
  const share = (/** @type {IterationRow} */ row, /** @type {ScoredStage | undefined} */ stage) => (by === "rank" ? ranks.get(row.obj)[row.arm] : scale(stage));
  const cells = rows.map((row, i) => ({
    k: row.k, obj: row.obj, arm: row.arm, share: share(row, accepted[i]), score: accepted[i]?.score,
    faint: (focus != null && row.obj !== focus) || (arm != null && row.arm !== arm),
  }));
  // Several objects have a lane each; once one is chosen its hypotheses have, below a band in the objects' colours.
  const chosen = objects.find((o) => o.id === focus);
  const lanes = !chosen
    ? objects.map((o) => ({ name: o.label, color: o.color, has: (c) => c.obj === o.id, id: o.id, arm: null }))
    : startsOf(runData, chosen).map((_, j) => ({ name: `hyp. ${j + 1}`, has: (c) => c.obj === chosen.id && c.arm === j,
      color: null, id: null, arm: j }));
  const band = several && chosen ? new Map(objects.map((o) => [o.id, o.color])) : null;
  const marks = runData.marks.filter((m) => !hidden.has(m.tone));
  const curves = objects.filter((o) => focus == null || o.id === focus).map((o) => ({
    color: several ? o.color : palette.stages.best,
    points: rowsOf(runData, o.id).map((r) => [r.k, r.best.score]),
    first: Math.max(...startsOf(runData, o).map((a) => a.score ?? 0)),
  }));
  const dots = focus == null ? [] : cells.filter((c) => c.obj === focus && c.score != null);
  const answers = runData.over ? [...last.values()].map(({ obj: id, best }) => ({ obj: id, ...best }))
    .filter((b) => b.k) : [];
  return { answers, band, chosen, total: Math.max(total, rows.length, 1), done: rows.length, cells, lanes, marks,
    curves, dots, several, focus };
}

/** @typedef {ReturnType<typeof modelOf>} Model */

const MARK_ROWS = [["problem"], ["rejected", "flip", "edited"], ["switched", "best"]];

// Where everything lies [px].
/** @param {Model} model @param {number[]} size */
export function placeOf(model, [w, h, rem, ratio]) {
  const longest = Math.max(...model.lanes.map((l) => l.name.length), 6);
  const left = Math.round(Math.min(rem * 11.5, rem * (1.4 + 0.53 * longest)) + (model.several ? rem : 0));
  const band = model.band ? Math.round(rem * 0.6) : 0;
  const right = Math.round(rem * 2.6);
  const marksTop = Math.round(rem * 1.15); // below the number of the cursor
  const groups = MARK_ROWS.filter((tones) => model.marks.some((m) => tones.includes(m.tone)));
  const mark = Math.round(rem * 0.8);
  const marks = groups.length * mark + Math.round(rem * 0.25) + band;
  const axis = Math.round(rem * 1.15);
  const room = Math.max(0, h - marksTop - marks - axis);
  const n = Math.max(model.lanes.length, 1);
  const most = room * (model.several && !model.chosen ? 0.6 : 0.52);
  const strip = most / n < rem * (model.several && !model.chosen ? 0.75 : 0.5); // objects are named in their lanes
  const lane = strip ? Math.min(rem * 1.3, room * 0.35) : Math.min(most / n, rem * 1.3);
  const lanesTop = marksTop + marks;
  const lanes = strip ? lane : lane * n;
  const curveTop = lanesTop + lanes + rem * 0.5;
  return {
    w, h, rem, ratio, left, right, marksTop, mark, groups, band, lanesTop, lane, lanes, strip, curveTop,
    curveBottom: h - axis - rem * 0.2, cell: (w - left - right) / model.total,
  };
}

// A text with its end left out where it is wider than there is room.
function shortened(ctx, text, room) {
  let n = text.length;
  while (n > 1 && ctx.measureText(n < text.length ? `${text.slice(0, n)}…` : text).width > room) n -= 1;
  return n < text.length ? `${text.slice(0, n)}…` : text;
}

// The drawing. A pen has the canvas's context, its colours from the style sheet, and where iteration k is: `x(k)`.

function penOf(canvas, { w, h, rem, ratio, left, cell }) {
  canvas.width = Math.round(w * ratio);
  canvas.height = Math.round(h * ratio);
  Object.assign(canvas.style, { width: `${w}px`, height: `${h}px` });
  const ctx = canvas.getContext("2d");
  ctx.scale(ratio, ratio);
  ctx.textBaseline = "middle";
  const css = getComputedStyle(canvas);
  const [text, dim, line] = ["--text", "--dim", "--line"].map((n) => css.getPropertyValue(n));
  const font = (size) => (ctx.font = `${(size * rem).toFixed(1)}px ${css.fontFamily}`);
  return { ctx, text, dim, line, font, x: (k) => left + (k - 0.5) * cell };
}

export function draw(canvas, model, place) {
  const pen = penOf(canvas, place);
  drawLanes(pen, model, place);
  drawCells(pen, model, place);
  drawAnswers(pen, model, place);
  drawScores(pen, model, place);
  drawMarks(pen, model, place);
  drawAxis(pen, model, place);
}

const thick = (rem) => Math.max(2, rem * 0.14);

// Names of the lanes, and hairlines over all of the run; lanes that have no room are one strip.
function drawLanes({ ctx, text, dim, line, font }, model, { w, rem, left, right, lane: height, lanesTop, strip }) {
  ctx.textAlign = "left";
  for (const [i, lane] of (strip ? model.lanes.slice(0, 1) : model.lanes).entries()) {
    const top = lanesTop + i * height;
    ctx.fillStyle = line;
    ctx.fillRect(left, Math.round(top + height) - 1, w - right - left, 1);
    font(lane.color ? Math.min(0.86, height / rem) : 0.86);
    ctx.fillStyle = dim;
    if (strip) {
      ctx.fillText(`${model.lanes.length} ${model.chosen ? "hyp." : "objects"}`, rem * 0.7, top + height / 2);
      return;
    }
    let from = rem * 0.7;
    if (lane.color) {
      ctx.fillStyle = lane.color;
      ctx.fillRect(from, top + height / 2 - rem * 0.28, rem * 0.56, rem * 0.56);
      from += rem * 0.9;
      ctx.fillStyle = text;
    }
    if (lane.arm != null && height >= rem * 0.7 && model.done && !model.cells.some(lane.has)) ctx.fillText("0 calls", left + rem * 0.4, top + height / 2);
    if (lane.color || height >= rem * 0.8 || i % 2 === 0) {
      ctx.fillText(shortened(ctx, lane.name, left - rem * 0.5 - from), from, top + height / 2);
    }
  }
}

// The lane of a cell or an answer, -1 = none.
const laneOf = (model, strip, one) => (strip ? 0 : model.lanes.findIndex((lane) => lane.has(one)));
const isShown = (model) => (one) => !model.chosen || one.obj === model.chosen.id;

// A cell where there was an iteration; above the hypotheses of one object a band in the objects' colours.
function drawCells({ ctx, x }, model, { cell, band, lane, lanesTop, strip }) {
  const gap = cell > 4 ? Math.min(1, cell * 0.2) : 0;
  const hasColours = strip && model.lanes.some((l) => l.color);
  if (model.band) {
    for (const c of model.cells) {
      ctx.fillStyle = model.band.get(c.obj);
      ctx.fillRect(x(c.k) - cell / 2, lanesTop - band, cell + 0.3, band - 2);
    }
  }
  for (const c of model.cells.filter(isShown(model))) {
    const i = laneOf(model, strip, c);
    if (i < 0) continue;
    ctx.globalAlpha = c.faint ? 0.22 : 1;
    ctx.fillStyle = hasColours ? model.lanes.find((l) => l.has(c)).color : rampColor(c.share);
    ctx.fillRect(x(c.k) - cell / 2 + gap / 2, lanesTop + i * lane + 1, Math.max(cell - gap, 0.8), lane - 2.5);
  }
  ctx.globalAlpha = 1;
}

// A frame around the iterations that made the answers.
function drawAnswers({ ctx, x }, model, { rem, cell, lane, lanesTop, strip }) {
  ctx.strokeStyle = palette.stages.best;
  ctx.lineWidth = thick(rem);
  const width = Math.max(cell, 5);
  for (const c of model.answers.filter(isShown(model))) {
    ctx.strokeRect(x(c.k) - width / 2, lanesTop + laneOf(model, strip, c) * lane + 0.5, width, lane - 1.5);
  }
}

// Scores, where there is room: the best so far as steps, accepted poses as points, answers as rings.
function drawScores(pen, model, place) {
  const { rem, curveTop: top, curveBottom: bottom } = place;
  const values = [...model.dots.map((d) => d.score), ...model.curves.flatMap((c) => [c.first, ...c.points.map((q) => q[1])])]
    .filter((v) => v != null);
  if (bottom - top <= rem || !values.length) return;
  const low = Math.max(0, Math.floor(Math.min(...values) * 10 - 0.3) / 10);
  const high = Math.min(1, Math.ceil(Math.max(...values) * 10 + 0.3) / 10);
  const y = (v) => bottom - ((v - low) / (high - low || 1)) * (bottom - top);
  drawScale(pen, place, y, bottom - top > rem * 3.5 ? [low, (low + high) / 2, high] : [low, high]);
  drawBest(pen, model, place, y);
  drawAccepted(pen, model, place, y);
}

function drawScale({ ctx, dim, line, font }, { w, rem, left, right, curveTop: top, curveBottom: bottom }, y, values) {
  font(0.86);
  ctx.fillStyle = dim;
  ctx.textAlign = "left";
  ctx.fillText("score", rem * 0.7, (top + bottom) / 2);
  for (const v of values) {
    ctx.fillStyle = line;
    ctx.fillRect(left, Math.round(y(v)), w - right - left, 1);
    ctx.fillStyle = dim;
    const at = Math.max(top + rem * 0.3, Math.min(bottom - rem * 0.2, y(v)));
    ctx.fillText(v.toFixed(2), w - right + rem * 0.4, at);
  }
}

function drawBest({ ctx, x }, model, { rem, left, cell }, y) {
  ctx.lineWidth = Math.max(1, rem * 0.1);
  for (const curve of model.curves) {
    ctx.strokeStyle = curve.color;
    ctx.beginPath();
    let last = y(curve.first);
    ctx.moveTo(left, last);
    for (const [k, v] of curve.points) {
      ctx.lineTo(x(k), last);
      ctx.lineTo(x(k), (last = y(v)));
    }
    ctx.lineTo(left + model.done * cell, last);
    ctx.stroke();
  }
}

function drawAccepted({ ctx, dim, x }, model, { rem, cell }, y) {
  ctx.strokeStyle = dim;
  ctx.lineWidth = 1;
  ctx.globalAlpha = 0.45;
  ctx.beginPath();
  model.dots.forEach((d, i) => (i ? ctx.lineTo(x(d.k), y(d.score)) : ctx.moveTo(x(d.k), y(d.score))));
  ctx.stroke();
  const r = Math.max(1.5, Math.min(rem * 0.22, cell * 0.3));
  const circle = (one, radius) => {
    ctx.beginPath();
    ctx.arc(x(one.k), y(one.score), radius, 0, 7);
  };
  for (const d of model.dots) {
    ctx.globalAlpha = d.faint ? 0.2 : 1;
    ctx.fillStyle = rampColor(d.share);
    circle(d, r);
    ctx.fill();
  }
  ctx.globalAlpha = 1;
  ctx.strokeStyle = palette.stages.best;
  ctx.lineWidth = thick(rem);
  for (const c of model.answers.filter((one) => model.focus == null || one.obj === model.focus)) {
    circle(c, r + 2.5);
    ctx.stroke();
  }
}

/** @type {Record<string, Path2D>} */
const paths = {}; // by shape
// Marks, a row for each kind; several of an iteration beside each other.
function drawMarks({ ctx, dim, x }, model, { rem, cell, groups, mark, marksTop }) {
  const half = Math.max(3, Math.min(rem * 0.4, 0.6 * cell + 1.5));
  const drawn = new Map(); // iteration and row → how many
  for (const m of model.marks) {
    const { shape } = TONES[m.tone] ?? { shape: "circle" };
    const row = groups.findIndex((tones) => tones.includes(m.tone));
    const n = drawn.get(`${m.k} ${row}`) ?? 0;
    drawn.set(`${m.k} ${row}`, n + 1);
    ctx.save();
    ctx.globalAlpha = model.focus != null && m.obj !== model.focus ? 0.25 : 1;
    ctx.translate(x(m.k) + n * Math.min(half * 2, cell / 2), marksTop + mark * (row + 0.5));
    ctx.scale(half / 5, half / 5);
    ctx.fillStyle = palette.marks[m.tone] ?? dim;
    ctx.fill((paths[shape] ??= new Path2D(SHAPES[shape])));
    ctx.restore();
  }
}

// Numbers of iterations, and a line where those end that are made.
function drawAxis({ ctx, dim, line, font, x }, model, { h, rem, left, cell, marksTop, curveBottom }) {
  font(0.86);
  ctx.textAlign = "center";
  ctx.fillStyle = dim;
  const every = [1, 2, 5, 10, 20, 25, 50, 100, 200, 500, 1000].find((n) => n * cell > rem * 3) ?? 1000;
  for (let k = every; k <= model.total; k += every) ctx.fillText(String(k), x(k), h - rem * 0.6);
  ctx.textAlign = "left";
  ctx.fillText("iteration", rem * 0.7, h - rem * 0.6);
  if (model.done >= model.total) return;
  ctx.strokeStyle = line;
  ctx.lineWidth = thick(rem);
  ctx.setLineDash([3, 3]);
  ctx.beginPath();
  ctx.moveTo(left + model.done * cell, marksTop);
  ctx.lineTo(left + model.done * cell, curveBottom);
  ctx.stroke();
}
