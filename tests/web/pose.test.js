// Poses moved as a mouse over the image moves them.
import assert from "node:assert/strict";
import { test } from "node:test";
import { between, displaced, displacement, dragged, origin, pointAt, project, receded, turned } from "../../verefine_viz/page/web/pose.js";

const K = [500, 0, 320, 0, 500, 240, 0, 0, 1];
const START = turned([1, 0, 0, 0.1, 0, 1, 0, -0.2, 0, 0, 1, 0.8, 0, 0, 0, 1], [1, 2, 3], 0.7);
const close = (a, b, within = 1e-9) => a.every((x, i) => Math.abs(x - b[i]) < within);

test("a drag by pixels moves the origin by as many pixels in the image", () => {
  const [[u0, v0], [u1, v1]] = [START, dragged(START, 12, -7, K)].map((T) => project(origin(T), K));
  assert.ok(close([u1 - u0, v1 - v0], [12, -7]));
});

test("what recedes stays where it is in the image, and ends before the camera", () => {
  const far = receded(START, 0.1);
  assert.ok(close(project(origin(far), K), project(origin(START), K)));
  assert.ok(Math.abs(between(START, far).mm - 100) < 1e-9);
  assert.equal(receded(START, -10), START);
});

test("a pixel at its depth is the point that projects there", () => {
  assert.ok(close(project(pointAt([100, 50], 0.9, K), K), [100, 50]));
});

test("turns are measured over the whole range, and many of them leave a rotation", () => {
  for (const deg of [0.001, 30, 90, 179.9]) {
    assert.ok(Math.abs(between(START, turned(START, [0, 1, 0], (deg * Math.PI) / 180)).deg - deg) < 1e-6, `${deg}°`);
  }
  let T = START;
  for (let i = 0; i < 1000; i++) T = turned(T, [i % 3, 1, -2], 0.3);
  const column = (j) => [T[j], T[4 + j], T[8 + j]];
  const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
  for (const i of [0, 1, 2]) for (const j of [0, 1, 2]) assert.ok(Math.abs(dot(column(i), column(j)) - (i === j)) < 1e-12);
});

test("six numbers lead from one pose to another, along the camera's axes and the object's", () => {
  const to = dragged(turned(START, [3, -1, 2], 0.4), 30, 10, K);
  for (const axes of ["camera", "object"]) {
    const [shift, turn] = displacement(START, to, axes);
    assert.ok(close(displaced(START, shift, turn, axes), to), axes);
  }
});
