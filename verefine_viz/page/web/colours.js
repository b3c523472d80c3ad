// Colour scales of the score maps, and arrays drawn with them; the colours are those of core/palette.py.

export const EMPTY = "#26282c"; // pixels without a value
const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137],
  [53, 183, 121], [109, 205, 89], [180, 222, 44], [253, 231, 37]];
const INFERNO = [[0, 0, 4], [31, 12, 72], [85, 15, 109], [136, 34, 106], [186, 54, 85], [227, 89, 51], [249, 140, 10],
  [249, 201, 50], [252, 255, 164]];
const BLUE_RED = [[33, 102, 172], [103, 169, 207], [209, 229, 240], [250, 250, 250], [253, 219, 199], [239, 138, 98],
  [178, 24, 43]];
const MAGENTA_GREEN = [[197, 27, 125], [233, 163, 201], [253, 224, 239], [247, 247, 247], [230, 245, 208],
  [161, 215, 106], [77, 146, 33]];

export const CLASSES = [
  { name: "explained", color: "#3cb44b", words: "in the mask, rendered and observed agree within τ" },
  { name: "missed", color: "#dc322f", words: "in the mask; the pose leaves it empty, or puts it behind the surface" },
  { name: "protruding", color: "#d336b4", words: "rendered where the sensor saw through, or outside the mask" },
  { name: "hidden", color: "#607d8b", words: "something nearer stands in front" },
  { name: "unknown", color: "#c8c8c8", words: "rendered, but nothing was measured there" },
];

const packed = ([r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0; // little-endian RGBA
const unpacked = (color) => color.match(/\w\w/g).map((x) => parseInt(x, 16));
const CLASS_TABLE = new Uint32Array([0, ...CLASSES.map((c) => packed(unpacked(c.color)))]);

// 256 packed colours, evenly between the anchors.
const tables = new Map();
export function table(anchors) {
  if (!tables.has(anchors)) {
    tables.set(anchors, Uint32Array.from({ length: 256 }, (_, i) => {
      const at = (i / 255) * (anchors.length - 1);
      const low = Math.min(Math.floor(at), anchors.length - 2);
      return packed(anchors[low].map((c, k) => Math.round(c + (anchors[low + 1][k] - c) * (at - low))));
    }));
  }
  return tables.get(anchors);
}

export const gradient = (anchors) => `linear-gradient(to right, ${anchors.map((c) => `rgb(${c})`).join(", ")})`;

// What each map shows. `of(side)`: its array. `factor`: from the array's unit to the one shown. `range(side)`: the ends
// of the scale: the same colour means the same number at every pose. `where(side)`: an array that is 0
// where there is no value. `shared`: one for A and B. `colour`: only where colour counts. `ends`: words at the ends.
const depth = (side) => side.scale.depth;
export const MAPS = {
  observed: {
    label: "observed", hint: "depth that the sensor measured", unit: "m", digits: 4, anchors: VIRIDIS, range: depth,
    shared: true, of: (side) => side.arrays.depth, where: (side) => side.arrays.depth,
  },
  rendered: {
    label: "rendered", hint: "depth of the model at the pose", unit: "m", digits: 4, anchors: VIRIDIS, range: depth,
    of: (side) => side.arrays.rendered, where: (side) => side.arrays.rendered,
  },
  difference: {
    label: "difference", unit: "mm", digits: 1, sign: true, factor: 1000, anchors: BLUE_RED, marks: true,
    hint: "observed − rendered: red, the sensor saw past the model; blue, something is before it; the marks are ±τ",
    range: (side) => [-2 * side.scale.tau_mm, 2 * side.scale.tau_mm], of: (side) => side.arrays.difference,
  },
  angle: {
    label: "angle", hint: "between observed and rendered surface normal", unit: "°", digits: 0, factor: 180 / Math.PI,
    anchors: INFERNO, range: () => [0, 90], of: (side) => side.arrays.angle,
  },
  f_d: {
    label: "depth fit f_d", hint: "1 = same depth, 0 = off by τ or more; where the pixel counts", digits: 2,
    anchors: VIRIDIS, range: () => [0, 1], of: (side) => side.arrays.f_d, where: (side) => side.arrays.counted,
  },
  f_n: {
    label: "normal fit f_n", hint: "1 = same direction, 0 = beyond the cut-off angle; where the pixel counts",
    digits: 2, anchors: VIRIDIS, range: () => [0, 1],
    of: (side) => side.arrays.f_n, where: (side) => side.arrays.counted,
  },
  classes: {
    label: "classes", hint: "why each pixel counts as it does", classes: true, of: (side) => side.arrays.classes,
  },
  gain: {
    label: "gain of B", digits: 2, sign: true, anchors: MAGENTA_GREEN, ends: ["A", "B"], shared: true,
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
    label: "correlation", digits: 2, sign: true, anchors: [...BLUE_RED].reverse(), colour: true,
    hint: "what each explained pixel adds to f_c: blue, for this pose; red, against it",
    range: () => [-2, 2], of: (side) => side.arrays.correlation,
  },
};

// Draws an array (h, w) into packed pixels; transparent where there is no value.
export function paint(map, side, out) {
  const values = map.of(side);
  const where = map.where?.(side);
  if (map.rgb) {
    for (let i = 0; i < out.length; i++) {
      out[i] = where && !where[i] ? 0 : packed([values[3 * i], values[3 * i + 1], values[3 * i + 2]]);
    }
  } else if (map.classes) {
    for (let i = 0; i < out.length; i++) out[i] = CLASS_TABLE[values[i]];
  } else {
    const [low, high] = map.range(side);
    const colours = table(map.anchors);
    const a = (255 * (map.factor ?? 1)) / (high - low);
    const b = (-255 * low) / (high - low) + 0.5;
    for (let i = 0; i < out.length; i++) {
      const x = a * values[i] + b;
      out[i] = x !== x || (where && !where[i]) ? 0 : colours[x < 0 ? 0 : x > 255 ? 255 : x | 0]; // NaN is not itself
    }
  }
}

// The value at a place of the array, in the unit that is shown; null where there is none.
export function valueAt(map, side, i) {
  const values = map.of?.(side);
  if (!values || i < 0 || (map.where && !map.where(side)[i])) return null;
  if (map.rgb) return [values[3 * i], values[3 * i + 1], values[3 * i + 2]];
  if (map.classes) return values[i] ? CLASSES[values[i] - 1].name : null;
  const value = values[i] * (map.factor ?? 1);
  return Number.isNaN(value) ? null : value;
}

export function valueText(map, value) {
  if (value == null) return "–";
  if (typeof value === "string") return value;
  if (Array.isArray(value)) return value.join(" ");
  const text = value.toFixed(map.digits);
  if (Number(text) === 0) return text.replace("-", "");
  return `${map.sign && value > 0 ? "+" : ""}${text}`.replace("-", "−");
}

// Labels at the low end, the middle and the high end of a scale.
export function ticks(map, side) {
  const [low, high] = map.range(side);
  if (map.ends) return [`${map.ends[0]} −${high}`, "0", `${map.ends[1]} +${high}`];
  return [low, (low + high) / 2, high].map((x) => `${Number(x.toFixed(3))}`.replace("-", "−"));
}

// The fit ½ (f_d + f_n) of each pixel at B less that at A, over the part that holds both; 0 where a pixel does not count.
export function gainOf(a, b) {
  const u0 = Math.min(a.region[0], b.region[0]);
  const v0 = Math.min(a.region[1], b.region[1]);
  const w = Math.max(a.region[0] + a.region[2], b.region[0] + b.region[2]) - u0;
  const h = Math.max(a.region[1] + a.region[3], b.region[1] + b.region[3]) - v0;
  const gain = new Float32Array(w * h).fill(NaN);
  for (const [side, sign] of [[a, -0.5], [b, 0.5]]) {
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
