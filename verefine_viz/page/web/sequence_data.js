// A sequence as columns: what is drawn of the frames in sight, and what a span of them comes to. Typed arrays alone.

/** @import { SequenceAnswer } from "./messages.d.ts" */
/** @import { Arrays } from "./store.js" */

/**
 * What cells and curves can say. worst: which of several frames in a pixel is seen; top: the value at the end of the scale,
 * which grows to the largest there is where `grows`.
 * @typedef {object} Measure
 * @property {string} id  of the array
 * @property {string} title
 * @property {string} unit
 * @property {"max" | "min"} worst
 * @property {number} top  of motions replaced by what counts as a jump
 * @property {number} factor  from the array to what is shown
 * @property {number} digits
 * @property {boolean} [grows]
 * @property {number} [known]  in how many cells it is known
 */
/** @type {Measure[]} */
export const MEASURES = [
  { id: "share", title: "Error", unit: "% of the diameter", worst: "max", top: 20, factor: 100, digits: 1 },
  { id: "score", title: "Score", unit: "", worst: "min", top: 1, factor: 1, digits: 2 },
  { id: "recorded_score", title: "Recorded score", unit: "", worst: "min", top: 1, factor: 1, digits: 2, grows: true },
  { id: "colour_fit", title: "Colour fit", unit: "", worst: "min", top: 1, factor: 1, digits: 2 },
  { id: "undetermined_mm", title: "Undetermined", unit: "mm", worst: "max", top: 30, factor: 1, digits: 1 },
  { id: "missing_depth", title: "No depth", unit: "%", worst: "max", top: 100, factor: 100, digits: 0 },
  { id: "moved_mm", title: "Moved", unit: "mm", worst: "max", top: 50, factor: 1, digits: 1 },
  { id: "turned_deg", title: "Turned", unit: "°", worst: "max", top: 30, factor: 1, digits: 1 },
];
export const [NOTHING, POSE, NO_POSE, NOT_SOLVED] = [0, 1, 2, 3];
export const MARKS = /** @type {const} */ (["flip", "jump", "lost", "recovered"]);

/**
 * An answer to the want `sequence` with its arrays: by measure and lane a Float32Array over the frames.
 * @typedef {object} Lanes
 * @property {SequenceAnswer} answer
 * @property {number} n  frames
 * @property {Measure[]} measures  that something is known of
 * @property {Record<string, Float32Array[]>} values
 * @property {Float32Array[]} states  as all that is drawn
 * @property {Int32Array[]} keys  of answers in the gallery, -1 = in none
 */
/**
 * @param {SequenceAnswer} answer
 * @param {Arrays} arrays
 * @returns {Lanes}
 */
export function lanesOf(answer, arrays) {
  const n = answer.frames.length;
  /** @type {<T extends Float32Array | Int32Array>(array: T) => T[]} */
  const split = (array) => answer.lanes.map((_, lane) => /** @type {typeof array} */ (array.subarray(lane * n, (lane + 1) * n)));
  const measures = MEASURES.filter(({ id }) => arrays[id]).map((m) =>
    ({ ...m, top: topOf(m, answer, arrays), known: knownIn(arrays[m.id]) }));
  return {
    answer, n, measures,
    values: Object.fromEntries([...measures.map(({ id }) => id), "err"].filter((id) => arrays[id])
      .map((id) => [id, split(/** @type {Float32Array} */ (arrays[id]))])),
    states: split(Float32Array.from(arrays.state)), keys: split(/** @type {Int32Array} */ (arrays.key)),
  };
}
// What is coloured by until it is chosen: error, score, …, the first that is known of half of the cells that any is known of.
/** @param {Lanes} lanes */
export const firstOf = ({ measures }) => measures.find((m) => 2 * m.known >= Math.max(...measures.map((one) => one.known)));
/** @type {(measure: Measure, answer: SequenceAnswer, arrays: Arrays) => number} */
const topOf = ({ id, grows, top }, { jump_mm, jump_deg }, arrays) => (
  grows ? largest(arrays[id]) || 1 : id === "moved_mm" ? jump_mm : id === "turned_deg" ? jump_deg : top);
// Of two scores that of more frames.
/** @param {Pick<Lanes, "measures">} lanes */
export function scoreOf({ measures }) {
  const [own, recorded] = ["score", "recorded_score"].map((id) => measures.find((m) => m.id === id));
  return (own?.known ?? 0) < (recorded?.known ?? 0) ? recorded : own;
}
const knownIn = (array) => array.reduce((n, v) => n + Number(v === v), 0);
const largest = (array) => array.reduce((a, b) => (b > a ? b : a), 0);

/** @typedef {{ size: number, low: Float32Array, high: Float32Array }} Blocks  of so many frames each */
/** @type {WeakMap<Float32Array, Blocks[]>} */
const pyramids = new WeakMap(); // values → blocks of 1, 2, 4, 8, … frames

/**
 * The largest blocks of which at least two are in a pixel of so many frames.
 * @type {(values: Float32Array, per: number) => Blocks}
 */
function blocksOf(values, per) {
  const level = Math.max(0, Math.floor(Math.log2(per / 2)));
  if (!pyramids.has(values)) pyramids.set(values, [{ size: 1, low: values, high: values }]);
  const levels = pyramids.get(values);
  while (levels.length <= level) {
    const { size, low, high } = levels.at(-1);
    const n = Math.ceil(low.length / 2);
    const above = { size: 2 * size, low: new Float32Array(n), high: new Float32Array(n) };
    for (let i = 0; i < n; i++) extremes(low, high, 2 * i, Math.min(low.length, 2 * i + 2), above.low, above.high, i);
    levels.push(above);
  }
  return levels[level];
}
/** @type {(low: Float32Array, high: Float32Array, first: number, end: number, least: Float32Array, most: Float32Array, at: number) => void} */
function extremes(low, high, first, end, least, most, at) {
  let a = low[first];
  let b = high[first];
  for (let i = first + 1; i < end; i++) {
    const l = low[i];
    const h = high[i];
    if (l < a || a !== a) a = l; // NaN is not itself
    if (h > b || b !== b) b = h;
  }
  least[at] = a;
  most[at] = b;
}

/**
 * The least and the largest value of the frames in each of w pixels, NaN where none is known; of very many frames those
 * beside them may be counted in.
 * @param {Float32Array} values
 * @param {{ from: number, to: number }} span  in frames
 * @param {Float32Array} least  (w,)
 * @param {Float32Array} most  (w,)
 */
export function reduce(values, { from, to }, least, most) {
  const per = (to - from) / least.length;
  const { size, low, high } = blocksOf(values, per);
  const n = low.length;
  for (let x = 0; x < least.length; x++) {
    const first = Math.min(n - 1, Math.floor((from + x * per) / size));
    const end = Math.min(n, Math.max(first + 1, Math.ceil((from + (x + 1) * per) / size)));
    extremes(low, high, first, end, least, most, x);
  }
}

/**
 * The span after zooming about a frame, within all there is and no closer than `LEAST` frames; `to` is Infinity for all.
 * @type {(span: { from: number, to: number }, n: number, by: number, about?: number) => { from: number, to: number }}
 */
export function zoomed(span, n, by, about) {
  const { from, to } = within(span, n);
  const at = about ?? (from + to) / 2;
  const width = Math.max(Math.min(LEAST, n), (to - from) / by);
  if (width >= n) return { from: 0, to: Infinity };
  return moved({ from: at - ((at - from) * width) / (to - from), to: 0 }, n, 0, width);
}
const LEAST = 8;
/** @type {(span: { from: number, to: number }, n: number) => { from: number, to: number }} */
export const within = ({ from, to }, n) => ({ from: Math.min(from, Math.max(0, n - 1)), to: Math.min(to, n) });
/** @type {(span: { from: number, to: number }, n: number, by: number, width?: number) => { from: number, to: number }} */
export function moved(span, n, by, width) {
  if (span.to === Infinity) return span;
  const size = width ?? span.to - span.from;
  const from = Math.max(0, Math.min(n - size, span.from + by));
  return { from, to: from + size };
}

/**
 * What the frames of a span, both ends included, come to for each lane; null = unknown.
 * @param {Lanes} lanes
 * @param {[number, number]} span
 * @param {number} correct  a pose is right below this share of the diameter
 */
export function statistics(lanes, [first, last], correct) {
  const { answer, values, states, n } = lanes;
  const end = Math.min(n, last + 1);
  return answer.lanes.map((lane, k) => {
    const part = (id) => (values[id] ? [...values[id][k].subarray(first, end)].filter((v) => v === v) : []);
    const [errors, shares, scores] = ["err", "share", scoreOf(lanes)?.id].map(part);
    const own = answer.marks.filter(([l, frame]) => l === k && frame >= first && frame < end);
    const poses = states[k].subarray(first, end).filter((s) => s === POSE).length;
    return {
      lane, frames: states[k].subarray(first, end).filter((s) => s === POSE || s === NO_POSE).length, poses,
      median: median(errors), right: shares.length ? shares.filter((s) => s < correct).length / shares.length : null,
      score: scores.length ? scores.reduce((a, b) => a + b) / scores.length : null,
      marks: Object.fromEntries(MARKS.map((kind) => [kind, own.filter((mark) => mark[2] === kind).length])),
    };
  });
}
/** @param {number[]} values */
function median(values) {
  if (!values.length) return null;
  const sorted = Float64Array.from(values).sort();
  return (sorted[(sorted.length - 1) >> 1] + sorted[sorted.length >> 1]) / 2;
}
