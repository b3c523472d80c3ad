// Undo and redo of a pose that is edited.
import assert from "node:assert/strict";
import { test } from "node:test";
import { moved, redone, rested, undone } from "../../verefine_viz/page/web/edit_history.js";

const at = (x) => [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1];
const xs = ({ past, T, future }) => [past.map((one) => one[3]), T[3], future.map((one) => one[3])];

test("a gesture is one step until it rests, and a move without one is a step of its own", () => {
  let edited = { obj: 0, arm: 0, T: at(0) };
  for (const x of [1, 2, 3]) edited = moved(edited, at(x), "drag");
  edited = moved(rested(edited), at(4), "drag");
  for (const x of [5, 6]) edited = moved(edited, at(x));
  assert.deepEqual(xs(edited), [[0, 3, 4, 5], 6, []]);
  assert.equal(moved(edited, at(6)), edited);
});

test("undo and redo go there and back, and a move in between forgets what was undone", () => {
  let edited = [1, 2, 3].reduce((one, x) => moved(one, at(x)), { obj: 0, arm: 0, T: at(0) });
  edited = undone(undone(edited));
  assert.deepEqual(xs(edited), [[0], 1, [2, 3]]);
  assert.deepEqual(xs(redone(redone(redone(edited)))), [[0, 1, 2], 3, []]);
  assert.deepEqual(xs(undone(undone(edited))), [[], 0, [1, 2, 3]]);
  assert.deepEqual(xs(moved(edited, at(9))), [[0, 1], 9, []]);
  assert.equal(edited.rests, false);
});
