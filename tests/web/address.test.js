// The page's address.
import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { answeredBy, receive, setView, state } from "../../verefine_viz/page/web/store.js";
import "../../verefine_viz/page/web/received.js";
import { linkOf } from "../../verefine_viz/page/web/address.js";
import { OPENED, row } from "./made_run.js";

beforeEach(() => {
  answeredBy({ send: () => false, load: () => Promise.resolve(null), address: (path) => path });
  state.frame = null;
  for (const message of OPENED) receive({ ...message });
});

test("it names the frame, and an object once one is chosen", () => {
  assert.equal(linkOf(state), "frame=0/0");
  setView({ obj: 7 });
  assert.equal(linkOf(state), "frame=0/0&object=7");
});

test("of several objects of a model it names the instance", () => {
  const [object] = state.frame.objects;
  state.frame.objects = [object, { ...object, id: 8 }];
  setView({ obj: 8 });
  assert.equal(linkOf(state), "frame=0/0&instance=8");
});

test("it names the iteration that is shown, and none before the first of a run that goes on", () => {
  receive({ t: "run", branch: 0, from: 0, total: 2, over: false, rows: [row(1), row(2)], marks: [] });
  setView({ k: 99 });
  assert.equal(linkOf(state), "frame=0/0&iteration=2");
  setView({ k: 0 });
  assert.equal(linkOf(state), "frame=0/0");
  receive({ t: "run", branch: 0, from: 2, total: 2, over: true, rows: [], marks: [] });
  setView({ k: 0 });
  assert.equal(linkOf(state), "frame=0/0&iteration=0");
});

test("a run of a batch is named by its folder", () => {
  state.frame.run = "rir seed 1";
  assert.equal(linkOf(state), "frame=0/0&run=rir%20seed%201");
});
