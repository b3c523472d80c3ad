// Colour scales of the score maps.
import assert from "node:assert/strict";
import { test } from "node:test";
import { MAPS, anchorsOf, gainOf, paint, ticks, valueAt, valueText } from "../../verefine_viz/page/web/colours.js";
import { learn, palette } from "../../verefine_viz/page/web/palette.js";
import { HELLO } from "./made_run.js";

learn(HELLO);

const side = (arrays, region = [0, 0, 2, 1]) => ({ region, arrays, scale: { depth: [0.5, 1.5], tau_mm: 20 }, score: null });
const painted = (name, arrays, n) => {
  const out = new Uint32Array(n);
  paint(MAPS[name], side(arrays), out);
  return [...out];
};
const packed = (r, g, b) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;

test("the ends of a scale have the first and the last colour; what is beyond them, too", () => {
  const anchors = anchorsOf(MAPS.angle).map((rgb) => packed(...rgb));
  const angles = Float32Array.of(0, Math.PI / 2, -1, 3);
  assert.deepEqual(painted("angle", { angle: angles }, 4), [anchors.at(0), anchors.at(-1), anchors.at(0), anchors.at(-1)]);
});

test("no value is transparent: NaN, a pixel that does not count, class 0", () => {
  assert.deepEqual(painted("angle", { angle: Float32Array.of(NaN) }, 1), [0]);
  assert.deepEqual(painted("f_d", { f_d: Float32Array.of(1), counted: Uint8Array.of(0) }, 1), [0]);
  assert.deepEqual(painted("classes", { classes: Uint8Array.of(0) }, 1), [0]);
});

test("classes have their colours, by number from 1", () => {
  const [r, g, b] = palette.classes[1].color.match(/\w\w/g).map((x) => parseInt(x, 16));
  assert.deepEqual(painted("classes", { classes: Uint8Array.of(2) }, 1), [packed(r, g, b)]);
});

test("the number under the mouse is in the unit that is shown", () => {
  const of = side({ difference: Float32Array.of(-0.0125, NaN), classes: Uint8Array.of(1, 0) });
  assert.ok(Math.abs(valueAt(MAPS.difference, of, 0) + 12.5) < 1e-5);
  assert.equal(valueText(MAPS.difference, valueAt(MAPS.difference, of, 0)), "−12.5");
  assert.equal(valueAt(MAPS.difference, of, 1), null);
  assert.equal(valueAt(MAPS.difference, of, -1), null); // outside
  assert.equal(valueAt(MAPS.classes, of, 0), palette.classes[0].name);
  assert.equal(valueAt(MAPS.classes, of, 1), null);
});

test("numbers have a sign where it means something, and zero has none", () => {
  assert.equal(valueText(MAPS.difference, 3), "+3.0");
  assert.equal(valueText(MAPS.difference, -0.01), "0.0");
  assert.equal(valueText(MAPS.f_d, 0.5), "0.50");
  assert.equal(valueText(MAPS.f_d, null), "–");
});

test("a scale is labelled at its ends and in its middle", () => {
  assert.deepEqual(ticks(MAPS.difference, side({})), ["−40", "0", "40"]);
  assert.deepEqual(ticks(MAPS.gain, side({})), ["A −1", "0", "B +1"]);
});

test("the gain of B over A covers both regions, and is empty where neither counts", () => {
  const fit = (f_d, f_n, counted, region) => side({ f_d: Float32Array.from(f_d), f_n: Float32Array.from(f_n), counted: Uint8Array.from(counted) }, region);
  const a = fit([1, 0.5], [1, 0.5], [1, 0], [10, 5, 2, 1]);
  const b = fit([1, 1], [0, 1], [1, 1], [11, 5, 2, 1]);
  const { region, arrays } = gainOf(a, b);
  assert.deepEqual(region, [10, 5, 3, 1]);
  assert.deepEqual([...arrays.gain], [-1, 0.5, 1]);
  const none = gainOf(fit([1], [1], [0], [0, 0, 1, 1]), fit([1], [1], [0], [0, 0, 1, 1]));
  assert.ok(Number.isNaN(none.arrays.gain[0]));
});
