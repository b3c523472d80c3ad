// Score maps: what each shows, and arrays drawn with the colours of the palette.
import { palette } from "./palette.js";

/** @import { MapScale, ScoreNumbers } from "./messages.d.ts" */
/** @import { Arrays } from "./store.js" */

/**
 * Arrays over a part of the image, [u0, v0, width, height].
 * @typedef {{ region: number[], arrays: Arrays, score?: ScoreNumbers, scale: MapScale, letter?: string,
 *   stale?: boolean }} Mapped
 */
/**
 * @typedef {object} ScoreMap
 * @property {string} label
 * @property {string} hint
 * @property {(side: Mapped) => Arrays[string]} of
 * @property {(side: Mapped) => Arrays[string]} [where]
 * @property {(side: Mapped) => number[]} [range]
 * @property {string} [unit]
 * @property {number} [digits]
 * @property {number} [factor]
 * @property {string} [colours]
 * @property {string[]} [ends]
 * @property {boolean} [sign]
 * @property {boolean} [marks]
 * @property {boolean} [reversed]
 * @property {boolean} [rgb]
 * @property {boolean} [classes]
 * @property {boolean} [shared]
 * @property {boolean} [colour]
 */

/** @param {number[]} color */
const packed = ([r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0; // little-endian RGBA
const unpacked = (/** @type {string} */ color) => color.match(/\w\w/g).map((x) => parseInt(x, 16));
const classTable = () => new Uint32Array([0, ...palette.classes.map((c) => packed(unpacked(c.color)))]);

// The anchors of a map's scale, low first.
/** @type {(map: Pick<ScoreMap, "colours" | "reversed">) => number[][]} */
export const anchorsOf = (map) => (map.reversed ? [...palette.scales[map.colours]].reverse() : palette.scales[map.colours]);

// 256 packed colours of a map, evenly between the anchors of its scale.
const tables = new Map(); // map → colours
/** @type {(map: Pick<ScoreMap, "colours" | "reversed">) => Uint32Array} */
export function tableOf(map) {
  if (!tables.has(map)) {
    const anchors = anchorsOf(map);
    tables.set(map, Uint32Array.from({ length: 256 }, (_, i) => {
      const at = (i / 255) * (anchors.length - 1);
      const low = Math.min(Math.floor(at), anchors.length - 2);
      return packed(anchors[low].map((c, k) => Math.round(c + (anchors[low + 1][k] - c) * (at - low))));
    }));
  }
  return tables.get(map);
}

/** @type {(anchors: number[][], to?: string) => string} */
export const gradient = (anchors, to = "right") => `linear-gradient(to ${to}, ${anchors.map((c) => `rgb(${c})`).join(", ")})`;

// What each map shows. `of(side)`: its array. `factor`: from the array's unit to the one shown. `range(side)`: the ends
// of the scale: the same colour means the same number at every pose. `where(side)`: an array that is 0
// where there is no value. `shared`: one for A and B. `colour`: only where colour counts. `ends`: words at the ends.
const depth = (/** @type {Mapped} */ side) => side.scale.depth;
/** @type {Record<string, ScoreMap>} */
export const MAPS = {
  observed: {
    label: "observed", hint: "depth that the sensor measured", unit: "m", digits: 4, colours: "viridis", range: depth,
    shared: true, of: (side) => side.arrays.depth, where: (side) => side.arrays.depth,
  },
  rendered: {
    label: "rendered", hint: "depth of the model at the pose", unit: "m", digits: 4, colours: "viridis", range: depth,
    of: (side) => side.arrays.rendered, where: (side) => side.arrays.rendered,
  },
  difference: {
    label: "difference", unit: "mm", digits: 1, sign: true, factor: 1000, colours: "blue_red", marks: true,
    hint: "observed − rendered: red, the sensor saw past the model; blue, something is before it; the marks are ±τ",
    range: (side) => [-2 * side.scale.tau_mm, 2 * side.scale.tau_mm], of: (side) => side.arrays.difference,
  },
  angle: {
    label: "angle", hint: "between observed and rendered surface normal", unit: "°", digits: 0, factor: 180 / Math.PI,
    colours: "inferno", range: () => [0, 90], of: (side) => side.arrays.angle,
  },
  f_d: {
    label: "depth fit f_d", hint: "1 = same depth, 0 = off by τ or more; where the pixel counts", digits: 2,
    colours: "viridis", range: () => [0, 1], of: (side) => side.arrays.f_d, where: (side) => side.arrays.counted,
  },
  f_n: {
    label: "normal fit f_n", hint: "1 = same direction, 0 = beyond the cut-off angle; where the pixel counts",
    digits: 2, colours: "viridis", range: () => [0, 1],
    of: (side) => side.arrays.f_n, where: (side) => side.arrays.counted,
  },
  classes: {
    label: "classes", hint: "why each pixel counts as it does", classes: true, of: (side) => side.arrays.classes,
  },
  gain: {
    label: "gain of B", digits: 2, sign: true, colours: "magenta_green", ends: ["A", "B"], shared: true,
    hint: "½ (f_d + f_n) of B less that of A, −1 to +1: green, B fits better there; magenta, A does",
    range: () => [-1, 1], of: (side) => side.arrays.gain,
  },
  observed_rgb: {
    label: "image colour", hint: "the image as the colour term sees it, smoothed", rgb: true, colour: true,
    shared: true, of: (side) => side.arrays.observed_rgb,
  },
  rendered_rgb: {
    label: "model colour", hint: "the model's colours at the pose, without light", rgb: true, colour: true,
    of: (side) => side.arrays.rendered_rgb, where: (side) => side.arrays.rendered,
  },
  correlation: {
    label: "adds to f_c", digits: 2, sign: true, colours: "blue_red", reversed: true, colour: true,
    hint: "what each explained pixel adds to the colour fit f_c, which is the mean: blue, for this pose; red, against it",
    range: () => [-2, 2], of: (side) => side.arrays.correlation,
  },
};

// Draws an array (h, w) into packed pixels; transparent where there is no value.
/** @type {(map: ScoreMap, side: Mapped, out: Uint32Array) => void} */
export function paint(map, side, out) {
  const values = map.of(side);
  if (!values) return; // of a picture without colours
  const where = map.where?.(side);
  if (map.rgb) {
    for (let i = 0; i < out.length; i++) {
      out[i] = where && !where[i] ? 0 : packed([values[3 * i], values[3 * i + 1], values[3 * i + 2]]);
    }
  } else if (map.classes) {
    const colours = classTable();
    for (let i = 0; i < out.length; i++) out[i] = colours[values[i]];
  } else {
    const [low, high] = map.range(side);
    const colours = tableOf(map);
    const a = (255 * (map.factor ?? 1)) / (high - low);
    const b = (-255 * low) / (high - low) + 0.5;
    for (let i = 0; i < out.length; i++) {
      const x = a * values[i] + b;
      out[i] = x !== x || (where && !where[i]) ? 0 : colours[x < 0 ? 0 : x > 255 ? 255 : x | 0]; // NaN is not itself
    }
  }
}

// The value at a place of the array, in the unit that is shown; null where there is none.
/** @type {(map: ScoreMap, side: Mapped, i: number) => number | string | number[] | null} */
export function valueAt(map, side, i) {
  const values = map.of?.(side);
  if (!values || i < 0 || (map.where && !map.where(side)[i])) return null;
  if (map.rgb) return [values[3 * i], values[3 * i + 1], values[3 * i + 2]];
  if (map.classes) return values[i] ? palette.classes[values[i] - 1].name : null;
  const value = values[i] * (map.factor ?? 1);
  return Number.isNaN(value) ? null : value;
}

/** @type {(map: ScoreMap, value: ReturnType<typeof valueAt>) => string} */
export function valueText(map, value) {
  if (value == null) return "–";
  if (typeof value === "string") return value;
  if (Array.isArray(value)) return value.join(" ");
  const text = value.toFixed(map.digits);
  if (Number(text) === 0) return text.replace("-", "");
  return `${map.sign && value > 0 ? "+" : ""}${text}`.replace("-", "−");
}

// Labels at the low end, the middle and the high end of a scale.
/** @type {(map: ScoreMap, side: Mapped) => string[]} */
export function ticks(map, side) {
  const [low, high] = map.range(side);
  if (map.ends) return [`${map.ends[0]} −${high}`, "0", `${map.ends[1]} +${high}`];
  return [low, (low + high) / 2, high].map((x) => `${Number(x.toFixed(3))}`.replace("-", "−"));
}

// The fit ½ (f_d + f_n) of each pixel at B less that at A, over the part that holds both; 0 where a pixel does not count.
/** @type {(a: Mapped, b: Mapped) => Mapped} */
export function gainOf(a, b) {
  const u0 = Math.min(a.region[0], b.region[0]);
  const v0 = Math.min(a.region[1], b.region[1]);
  const w = Math.max(a.region[0] + a.region[2], b.region[0] + b.region[2]) - u0;
  const h = Math.max(a.region[1] + a.region[3], b.region[1] + b.region[3]) - v0;
  const gain = new Float32Array(w * h).fill(NaN);
  /** @type {[Mapped, number][]} */
  const signed = [[a, -0.5], [b, 0.5]];
  for (const [side, sign] of signed) {
    const [u, v, width, height] = side.region;
    const { f_d, f_n, counted } = side.arrays;
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const i = y * width + x;
        if (!counted[i]) continue;
        const j = (y + v - v0) * w + x + u - u0;
        gain[j] = (gain[j] !== gain[j] ? 0 : gain[j]) + sign * (f_d[i] + f_n[i]);
      }
    }
  }
  return { region: [u0, v0, w, h], arrays: { gain }, score: b.score, scale: b.scale };
}

// The colour of a share in [0, 1] on a scale.
/** @type {(scale: string, share: number) => string} */
export function colorAt(scale, share) {
  const anchors = palette.scales[scale];
  const x = Math.max(0, Math.min(1, share)) * (anchors.length - 1);
  const i = Math.min(Math.floor(x), anchors.length - 2);
  return `rgb(${anchors[i].map((c, j) => Math.round(c + (anchors[i + 1][j] - c) * (x - i))).join()})`;
}
