// What the page makes of a run: `moment.js` with rows that no server sent.
import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { answeredBy, receive, setView, state } from "../../verefine_viz/page/web/store.js";
import "../../verefine_viz/page/web/received.js";
import { momentOf, rankShares } from "../../verefine_viz/page/web/moment.js";
import { seek, stepStage } from "../../verefine_viz/page/web/cursor.js";
import { OPENED, row } from "./made_run.js";

const came = (from, rows, over = false) => receive({ t: "run", branch: 0, from, total: 5, over, rows, marks: [] });
const at = () => momentOf(state);

beforeEach(() => {
  answeredBy({ send: () => false, load: () => Promise.resolve(null), address: (path) => path });
  state.frame = null;
  for (const message of OPENED) receive({ ...message });
});

test("the cursor follows rows only from the end", () => {
  came(0, [row(1), row(2)]);
  assert.equal(at().k, 2);
  seek(1);
  came(2, [row(3)]);
  assert.equal(at().k, 1);
  seek(3);
  came(3, [row(4)]);
  assert.equal(at().k, 4);
});

test("a link waits for its iteration and stays there", () => {
  came(0, [row(1)]);
  receive({ t: "view", patch: { branch: 0, k: 3 }, at: 3 });
  assert.equal(at().k, 1);
  came(1, [row(2), row(3), row(4)]);
  assert.equal(at().k, 3);
  came(4, [row(5)], true);
  assert.equal(at().k, 3);
});

test("stages are shown one by one", () => {
  came(0, [row(1), row(2)]);
  seek(1);
  const seen = [1, 2, 3].map(() => {
    stepStage();
    return [at().k, at().stage];
  });
  assert.deepEqual(seen, [[2, "current"], [2, "simulated"], [2, null]]);
});

test("a stage is compared with the one before it", () => {
  came(0, [row(1), row(2)]);
  seek(1);
  stepStage();
  stepStage();
  assert.equal(at().b.name, "simulated");
});

test("a finished run is compared with what shows most", () => {
  for (const [verdict, pair] of [
    [{ tone: "wrong", err: 44.0 }, ["best", "ground truth"]],
    [{ tone: "right", err: 1.0 }, ["best", "initial"]],
  ]) {
    came(0, [1, 2, 3, 4, 5].map(row), true);
    const outcome = { obj: 7, score: 0.6, limit: 10.0, findings: [], words: "", ...verdict };
    receive({ t: "verdict", branch: 0, objects: [outcome] });
    assert.deepEqual([at().isAnswer, at().a.name, at().b.name], [true, ...pair], verdict.tone);
  }
});

test("the same pose is not compared with itself, unless the user chose it", () => {
  assert.deepEqual([at().a.name, at().b.name, at().same], ["best", "ground truth", false]);
  setView({ a: "initial", b: "best" });
  assert.equal(at().same, true);
});

test("a hypothesis has one place, and so one colour, at every iteration", () => {
  const first = row(1);
  first.arms = first.arms.map((arm, j) => ({ ...arm, score: j ? 0.9 : 0.1 }));
  came(0, [first, row(2), row(3)]);
  for (const k of [1, 3]) {
    seek(k);
    assert.deepEqual(rankShares(at().run, at().object), [1, 0], `iteration ${k}`);
  }
});
