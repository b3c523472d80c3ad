// Draws a sequence on a canvas by columns: an axis of frames, a lane per object, marks on it, curves of one object.
import { tableOf } from "./colours.js";
import { palette, limits } from "./palette.js";
import { MARKS, NOT_SOLVED, NO_POSE, reduce, scoreOf, within } from "./sequence_data.js";

/** @import { Lanes, Measure } from "./sequence_data.js" */

/**
 * Where all is, in CSS pixels.
 * @typedef {object} Place
 * @property {number} left  of the frames
 * @property {number} width  of the frames
 * @property {number} top  of the lanes
 * @property {number} lane  height of one
 * @property {number} bottom  of the lanes
 * @property {number} curve  height of one
 * @property {number} height  of all
 * @property {number} rem
 */
/** @type {(lanes: Lanes, curves: Measure[], width: number, rem: number) => Place} */
export function placeOf({ answer }, curves, width, rem) {
  const left = Math.round(Math.min(9 * rem, 0.3 * width));
  const lane = Math.round(1.9 * rem);
  const top = Math.round(1.7 * rem);
  const bottom = top + lane * answer.lanes.length;
  const curve = Math.round(4.2 * rem);
  return { left, width: Math.max(1, Math.round(width - left - 0.5 * rem)), top, lane, bottom, curve, height: bottom + curve * curves.length + 0.5 * rem, rem };
}

// The curves under the lanes: error, score and motion, as far as they are known.
/** @param {Lanes} lanes */
export function curvesOf(lanes) {
  const of = (id) => lanes.measures.find((m) => m.id === id);
  return [of("share"), scoreOf(lanes), of("moved_mm"), of("turned_deg")].filter(Boolean);
}

export const SCALE = { colours: "viridis" }; // of all measures: more is brighter

/** @param {CanvasRenderingContext2D} ctx */
function packedColor(ctx, css) {
  ctx.fillStyle = css;
  const rgb = Number.parseInt(/** @type {string} */ (ctx.fillStyle).slice(1), 16);
  return 0xff000000 | ((rgb & 255) << 16) | (rgb & 0xff00) | (rgb >> 16);
}

/**
 * Pixels that are written one by one: a path per frame would take ten times as long.
 * @typedef {object} Raster
 * @property {ImageData} image
 * @property {Uint32Array} out  its pixels, packed
 * @property {Float32Array} low  a number per column
 * @property {Float32Array} high
 */
/** @type {WeakMap<HTMLCanvasElement, Raster>} */
const rasters = new WeakMap();
/** @type {(canvas: HTMLCanvasElement, ctx: CanvasRenderingContext2D, w: number, h: number) => Raster} */
function rasterOf(canvas, ctx, w, h) {
  let raster = rasters.get(canvas);
  if (raster?.image.width !== w || raster.image.height !== h) {
    const image = ctx.createImageData(w, h);
    raster = { image, out: new Uint32Array(image.data.buffer), low: new Float32Array(w), high: new Float32Array(w) };
    rasters.set(canvas, raster);
  }
  raster.out.fill(0);
  return raster;
}

/**
 * A lane from row y on, h pixels high.
 * @param {Raster} raster
 * @param {Lanes} lanes
 */
function drawLane({ out, low, high, image: { width: w } }, lanes, measure, span, lane, y, h, states) {
  const table = tableOf(SCALE);
  const scale = (255 * measure.factor) / measure.top;
  const row = out.subarray(y * w, (y + 1) * w);
  reduce(lanes.states[lane], span, low, high);
  for (let x = 0; x < w; x++) row[x] = states[high[x] === NOT_SOLVED && low[x] === NO_POSE ? NO_POSE : high[x]];
  reduce(lanes.values[measure.id][lane], span, low, high);
  const shown = measure.worst === "max" ? high : low;
  for (let x = 0; x < w; x++) {
    const v = shown[x];
    if (v === v) row[x] = table[Math.max(0, Math.min(255, v * scale)) | 0]; // NaN is not itself
  }
  for (let i = 1; i < h; i++) out.copyWithin((y + i) * w, y * w, (y + 1) * w);
}

/**
 * A curve between the rows top and floor: each column from the least to the largest value, joined with the one before.
 * @param {Raster} raster
 */
function drawCurve({ out, low, high, image: { width: w } }, values, measure, span, top, floor, { line, accent }) {
  reduce(values, span, low, high);
  const at = (v) => Math.round(floor - Math.max(0, Math.min(1, (v * measure.factor) / measure.top)) * (floor - top));
  out.fill(line, floor * w, (floor + 1) * w);
  if (measure.id === "share") out.fill(line, at(limits.correct) * w, (at(limits.correct) + 1) * w);
  let before = NaN;
  for (let x = 0; x < w; x++) {
    if (high[x] !== high[x]) {
      before = NaN;
      continue;
    }
    let [first, last] = [at(high[x]), at(low[x])];
    if (before < first) first = before;
    if (before > last) last = before;
    for (let y = first - 1; y <= last; y++) out[y * w + x] = accent;
    before = at(low[x]);
  }
}

function drawPixels(canvas, ctx, lanes, { measure, curves, lane, place }, span, color, ratio) {
  const [w, h] = [place.width, place.height - place.top].map((size) => Math.round(size * ratio));
  const raster = rasterOf(canvas, ctx, w, h);
  const packed = (name) => packedColor(ctx, color(name));
  const row = (y) => Math.round((y - place.top) * ratio);
  const states = Uint32Array.from([0, packed("--over"), packed("--faint"), packed("--over")]); // of what no number is known
  for (let k = 0; k < lanes.answer.lanes.length; k++) {
    drawLane(raster, lanes, measure, span, k, row(place.top + k * place.lane), Math.round((place.lane - 3) * ratio), states);
  }
  const colors = { line: packed("--line"), accent: packed("--accent") };
  curves.forEach((m, k) => {
    const y = place.bottom + k * place.curve;
    drawCurve(raster, lanes.values[m.id][lane], m, span, row(y + 0.6 * place.rem), row(y + place.curve - 0.3 * place.rem), colors);
  });
  drawMarks(raster, lanes, span, place, color, ratio);
  ctx.putImageData(raster.image, Math.round(place.left * ratio), Math.round(place.top * ratio));
}

/** @type {Record<string, (ctx: CanvasRenderingContext2D, x: number, y: number, r: number) => void>} */
const SHAPES = {
  flip: (ctx, x, y, r) => polygon(ctx, [x - r, y - r, x + r, y - r, x - r, y + r, x + r, y + r]), // an hourglass
  jump: (ctx, x, y, r) => polygon(ctx, [x, y - r, x + r, y, x, y + r, x - r, y]),
  lost: (ctx, x, y, r) => polygon(ctx, [x - r, y - r, x + r, y - r, x, y + r]),
  recovered: (ctx, x, y, r) => polygon(ctx, [x - r, y + r, x + r, y + r, x, y - r]),
};
function polygon(ctx, [x, y, ...rest]) {
  ctx.moveTo(x, y);
  for (let i = 0; i < rest.length; i += 2) ctx.lineTo(rest[i], rest[i + 1]);
  ctx.closePath();
}
/** @type {Map<string, ImageData>} */
const stamps = new Map(); // kind, size and colours → the pixels of the mark: thousands may be in sight
function stampOf(kind, r, edge) {
  const key = `${kind} ${r} ${edge}`;
  if (!stamps.has(key)) {
    const stamp = document.createElement("canvas");
    stamp.width = stamp.height = 2 * Math.ceil(r + 1);
    const ctx = stamp.getContext("2d");
    ctx.fillStyle = palette.motions[kind];
    ctx.strokeStyle = edge;
    ctx.beginPath();
    SHAPES[kind](ctx, stamp.width / 2, stamp.width / 2, r);
    ctx.fill();
    ctx.stroke();
    stamps.set(key, ctx.getImageData(0, 0, stamp.width, stamp.width));
  }
  return stamps.get(key);
}
/** @type {(raster: Raster, stamp: ImageData, x0: number, y0: number) => void} */
function press({ out, image: { data, width: w, height: h } }, { data: own, width: size }, x0, y0) {
  const whole = new Uint32Array(own.buffer);
  for (let y = Math.max(0, -y0); y < size && y0 + y < h; y++) {
    for (let x = Math.max(0, -x0); x < size && x0 + x < w; x++) {
      const packed = whole[y * size + x];
      const at = (y0 + y) * w + x0 + x;
      if (packed >= 0xff000000) out[at] = packed;
      if (packed < 0x01000000 || packed >= 0xff000000) continue;
      const [from, to] = [4 * (y * size + x), 4 * at];
      const share = own[from + 3] / 255;
      for (let c = 0; c < 3; c++) data[to + c] += share * (own[from + c] - data[to + c]);
      data[to + 3] = Math.max(data[to + 3], own[from + 3]);
    }
  }
}
function drawMarks(raster, { answer }, span, place, color, ratio) {
  const edge = color("--pane");
  const own = Object.fromEntries(MARKS.map((kind) => [kind, stampOf(kind, 0.36 * place.rem * ratio, edge)]));
  const half = own.flip.width / 2;
  const seen = new Set(); // places that have such a mark
  for (const [lane, frame, kind] of answer.marks) {
    if (frame < span.from - 1 || frame > span.to) continue;
    const x = Math.round((xOf(frame + 0.5, span, place) - place.left) * ratio);
    const key = (lane * 65536 + (x >> 2)) * 4 + MARKS.indexOf(kind);
    if (seen.has(key)) continue;
    seen.add(key);
    press(raster, own[kind], x - half, Math.round(((lane + 0.5) * place.lane - 0.5) * ratio) - half);
  }
}

/** @type {(frame: number, span: { from: number, to: number }, place: Place) => number} */
export const xOf = (frame, { from, to }, { left, width }) => left + ((frame - from) / (to - from)) * width;

function drawAxis(ctx, { answer, n }, span, place, color) {
  const { rem } = place;
  const widest = 1.2 * ctx.measureText(answer.frames.at(-1) ?? "").width + rem;
  const least = ((span.to - span.from) * widest) / place.width;
  const power = 10 ** Math.floor(Math.log10(Math.max(1, least)));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= least);
  ctx.fillStyle = color("--dim");
  ctx.textAlign = "center";
  ctx.strokeStyle = color("--line");
  ctx.beginPath();
  for (let i = Math.ceil(span.from / step) * step; i < Math.min(n, span.to); i += step) {
    const x = Math.round(xOf(i + 0.5, span, place)) + 0.5;
    if (x - widest / 2 < place.left - rem) continue;
    ctx.moveTo(x, place.top - 0.3 * rem);
    ctx.lineTo(x, place.top);
    ctx.fillText(answer.frames[i], Math.min(x, place.left + place.width - 0.42 * widest), 0.85 * rem);
  }
  ctx.stroke();
}

function drawNames(ctx, lanes, curves, chosen, place, color) {
  const { rem } = place;
  ctx.textAlign = "left";
  const write = (words, y, name) => {
    ctx.fillStyle = color(name);
    ctx.fillText(words, 0.5 * rem, y, place.left - rem);
  };
  lanes.answer.lanes.forEach(({ name }, k) => {
    if (k === chosen) {
      ctx.fillStyle = color("--accent-soft");
      ctx.fillRect(0, place.top + k * place.lane, place.left - 0.2 * rem, place.lane - 1);
    }
    write(name, place.top + (k + 0.5) * place.lane, k === chosen ? "--text" : "--dim");
  });
  curves.forEach(({ title, unit, top }, k) => {
    write(title, place.bottom + (k + 0.35) * place.curve, "--text");
    write(`0 to ${+top.toPrecision(2)} ${unit}`, place.bottom + (k + 0.7) * place.curve, "--dim");
  });
}

/**
 * Draws all.
 * @param {HTMLCanvasElement} canvas
 * @param {Lanes} lanes
 * @param {{ measure: Measure, curves: Measure[], from: number, to: number, lane: number, place: Place }} shown
 */
export function draw(canvas, lanes, { measure, curves, from, to, lane, place }) {
  const ratio = devicePixelRatio || 1;
  const span = within({ from, to }, lanes.n);
  const width = canvas.clientWidth;
  const [w, h] = [Math.round(width * ratio), Math.round(place.height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const ctx = canvas.getContext("2d");
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, width, place.height);
  const css = getComputedStyle(canvas);
  const color = (name) => css.getPropertyValue(name);
  ctx.font = `${0.85 * place.rem}px ${css.fontFamily}`;
  ctx.textBaseline = "middle";
  drawPixels(canvas, ctx, lanes, { measure, curves, lane, place }, span, color, ratio);
  drawAxis(ctx, lanes, span, place, color);
  drawNames(ctx, lanes, curves, lane, place, color);
}
