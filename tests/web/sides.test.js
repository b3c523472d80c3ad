// The maps of the two poses that are compared, with answers that no server gave.
import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { answeredBy, receive, state } from "../../verefine_viz/page/web/store.js";
import "../../verefine_viz/page/web/received.js";
import { momentOf } from "../../verefine_viz/page/web/moment.js";
import { indexAt, readAt, sideFor, sidesOf } from "../../verefine_viz/page/web/sides.js";
import { mapsOf } from "../../verefine_viz/page/web/wants.js";
import { OPENED, row } from "./made_run.js";

const DEPTH = Float32Array.of(1, 0, 1, 1); // 2 × 2 pixels, one without a value
const RENDERED = Float32Array.of(0.99, 1, 0, 1.01);
const ARRAYS = [...["rendered", "f_d", "f_n"].map((name) => [name, "float32", 0, 4, null]), ["counted", "uint8", 0, 4, null]];
let asked;
let opened = 0;

beforeEach(() => {
  asked = [];
  answeredBy({
    send: (verb) => Boolean(verb.verb === "want" ? asked.push(verb) : true),
    load: (key) => Promise.resolve(key === "depth" ? DEPTH.buffer : RENDERED.buffer),
    address: (path) => path,
  });
  opened += 1;
  for (const message of OPENED) {
    receive(message.t === "frame" ? { ...message, id: `sides ${opened}`, depth: "depth", camera: { w: 2, h: 2, K: [] } } : message);
  }
  receive({ t: "run", branch: 0, from: 0, total: 5, over: false, rows: [row(1)], marks: [] });
});

const sides = () => sidesOf(momentOf(state));
const turn = () => new Promise((done) => setImmediate(done));
function answerMaps(gone = null) {
  for (const { id } of asked.splice(0)) {
    const maps = { what: "maps", region: [0, 0, 2, 2], blob: `maps ${opened}`, arrays: ARRAYS, score: { score: 0.5 },
      scale: { depth: [0, 2], tau_mm: 20 } };
    receive({ t: "answer", id, answer: gone ? { what: "gone", gone } : maps });
  }
}
async function shown() {
  sides();
  answerMaps();
  sides();
  await turn();
  sides();
  await turn();
  return sides();
}

test("the maps of A and B are asked for, each once", () => {
  sides();
  sides();
  assert.deepEqual(asked.map(({ slot }) => slot), ["maps-a", "maps-b"]);
  const moment = momentOf(state);
  assert.deepEqual(asked[0].of, { what: "maps", branch: 0, k: 1, obj: 7, T: moment.a.T });
  assert.equal(mapsOf(moment, moment.a), mapsOf(moment, moment.a));
});

test("a side waits until its arrays are there, and then reads numbers from them", async () => {
  assert.equal(sides().a.stale, true);
  assert.equal(sideFor("rendered", sides(), "a"), null);
  const { a } = await shown();
  assert.equal(a.stale, false);
  assert.ok(Math.abs(readAt("rendered", a, [1, 1]) - 1.01) < 1e-6);
});

test("the difference is observed less rendered, and nothing where either is missing", async () => {
  const { a } = await shown();
  assert.ok(Math.abs(readAt("difference", a, [0, 0]) - 10) < 1e-3); // mm
  for (const pixel of [[1, 0], [0, 1]]) assert.equal(readAt("difference", a, pixel), null, String(pixel));
});

test("while the maps of another iteration come, those before stand for them", async () => {
  const before = await shown();
  receive({ t: "run", branch: 0, from: 1, total: 5, over: false, rows: [row(2)], marks: [] });
  const { a } = sides();
  assert.equal(a.stale, true);
  assert.equal(a.arrays, before.a.arrays);
});

test("a side without maps says why", () => {
  sides();
  answerMaps("It was discarded.");
  assert.deepEqual([sides().a.gone, sides().a.stale], ["It was discarded.", true]);
});

test("pixels outside the region have no index", () => {
  const side = { region: [10, 20, 4, 3] };
  assert.equal(indexAt(side, 10, 20), 0);
  assert.equal(indexAt(side, 13, 22), 11);
  for (const [u, v] of [[9, 20], [14, 20], [10, 19], [10, 23]]) assert.equal(indexAt(side, u, v), -1, `${u}, ${v}`);
});
