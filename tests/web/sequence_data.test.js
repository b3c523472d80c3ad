// A sequence's columns: what pixels show of many frames, zooming, and what a span comes to.
import assert from "node:assert/strict";
import { test } from "node:test";
import { lanesOf, moved, reduce, statistics, zoomed } from "../../verefine_viz/page/web/sequence_data.js";

const N = 1000;
const answer = {
  frames: Array.from({ length: N }, (_, i) => `0/${i}`), lanes: [{ name: "a" }, { name: "b" }],
  marks: [[0, 10, "flip"], [0, 20, "lost"], [0, 30, "recovered"], [1, 500, "jump"]],
};
const column = (of) => Float32Array.from({ length: 2 * N }, (_, i) => of(i % N, Math.floor(i / N)));
const arrays = {
  share: column((i, lane) => (i >= 20 && i < 30 && lane === 0 ? NaN : i % 4 === 0 ? 0.5 : 0.05)),
  err: column((i, lane) => (i >= 20 && i < 30 && lane === 0 ? NaN : i % 4 === 0 ? 50 : 5)),
  score: column((i) => i / N),
  state: Uint8Array.from({ length: 2 * N }, (_, i) => (i >= 20 && i < 30 ? 2 : 1)), key: Int32Array.from({ length: 2 * N }, (_, i) => i),
};
const lanes = lanesOf(/** @type {any} */ (answer), arrays);

test("each pixel shows the least and the largest of all its frames, at any zoom", () => {
  for (const [from, to, w] of [[0, N, 7], [0, N, 300], [3.7, 81.2, 1000], [0, N, 5000], [990, 1000, 64]]) {
    const [low, high] = [new Float32Array(w), new Float32Array(w)];
    reduce(lanes.values.score[1], { from, to }, low, high);
    let seen = Math.floor(from) - 1;
    for (let x = 0; x < w; x++) {
      const first = Math.round(low[x] * N);
      assert.ok(first <= seen + 1, "no frame is passed over");
      seen = Math.round(high[x] * N);
    }
    assert.equal(seen, Math.min(N, Math.ceil(to)) - 1);
  }
  const [low, high] = [new Float32Array(1), new Float32Array(1)];
  reduce(lanes.values.share[0], { from: 22, to: 28 }, low, high);
  assert.ok(Number.isNaN(low[0]) && Number.isNaN(high[0]), "nothing is known there");
});

test("zooming keeps the frame under the pointer, ends at all of them, and stays inside", () => {
  const all = { from: 0, to: Infinity };
  let span = all;
  for (let i = 0; i < 40; i++) {
    const before = span.to === Infinity ? N : span.to - span.from;
    const share = (300 - span.from) / before;
    span = zoomed(span, N, 1.25, 300);
    assert.ok(Math.abs((300 - span.from) / (span.to - span.from) - share) < 1e-9);
  }
  assert.equal(span.to - span.from, 8);
  assert.deepEqual(moved(span, N, 1e9), { from: N - 8, to: N });
  for (let i = 0; i < 60; i++) span = zoomed(span, N, 1 / 1.25);
  assert.deepEqual(span, all);
  assert.deepEqual(moved(all, N, 10), all);
});

test("a span is summed up by object", () => {
  const [a, b] = statistics(lanes, [0, 39], 0.1);
  assert.deepEqual(a.marks, { flip: 1, jump: 0, lost: 1, recovered: 1 });
  assert.deepEqual(b.marks, { flip: 0, jump: 0, lost: 0, recovered: 0 });
  assert.deepEqual([a.frames, a.poses, a.median, b.right], [40, 30, 5, 0.75]);
  assert.ok(Math.abs(a.score - 0.0195) < 1e-6);
  assert.deepEqual(statistics(lanes, [21, 25], 0.1)[0].median, null);
});
