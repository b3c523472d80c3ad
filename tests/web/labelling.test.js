// What a press in the photo asks for while a model is chosen, and which label is in hand.
import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { answeredBy, receive, setView, state, update } from "../../verefine_viz/page/web/store.js";
import "../../verefine_viz/page/web/received.js";
import * as labelling from "../../verefine_viz/page/web/labelling.js";
import { momentOf } from "../../verefine_viz/page/web/moment.js";
import { OPENED, poseAt } from "./made_run.js";

const { askedBy, ask, boxOf, decide, labelInHand, modelsNamed, progressOf, sketchAt, sketchedTo, snap, snapCandidate } = labelling;
const drawn = (isScribble, from, ...to) => to.reduce(sketchedTo, sketchAt(from, isScribble));
const label = (obj, x) => ({ obj, obj_id: 3, name: "mug", T: poseAt(x), light: "amber", state: "proposed", reasons: [], candidates: [{ T: poseAt(9), score: 0.5 }] });
const MODELS = [{ obj_id: 3, name: "red_mug", symmetry: "" }, { obj_id: 14, name: "box", symmetry: "" }];
const labels = (...all) => ({ t: "labels", frame: "0/0", models: MODELS, labels: all, frames: {}, undo: false, redo: false });

let sent;
let opened = 0;
beforeEach(() => {
  sent = [];
  answeredBy({ send: (verb) => Boolean(verb.verb === "look" || sent.push(verb)), load: () => Promise.resolve(null), address: (path) => path });
  update({ frame: null, labels: null, placing: false });
  opened += 1;
  for (const message of OPENED) receive(message.t === "frame" ? { ...message, id: `labels ${opened}`, source: "labels" } : message);
});

test("a click places, a box has its pixels whichever way it is drawn, and a scribble is without gaps", () => {
  assert.deepEqual(askedBy(sketchAt([5, 6], true), 3), { verb: "place", obj_id: 3, pixel: [5, 6] });
  assert.deepEqual(askedBy(drawn(false, [9, 2], [20, 30], [4, 8]), 3), { verb: "find", obj_id: 3, box: [4, 2, 10, 9] });
  const { scribble } = askedBy(drawn(true, [0, 0], [4, 2], [4, 5]), 3);
  assert.deepEqual([scribble[0], scribble.at(-1), scribble.length], [[0, 0], [4, 5], 8]);
  for (let i = 1; i < scribble.length; i++) {
    assert.equal(Math.max(...[0, 1].map((j) => Math.abs(scribble[i][j] - scribble[i - 1][j]))), 1);
  }
  const long = drawn(true, [0, 0], [9000, 0], [0, 0]);
  assert.equal(long.pixels.length, 10_000);
  assert.deepEqual(boxOf([[3, 4]]), [3, 4, 4, 5]);
});

test("a model is placed once: the next press waits for its label, and the label ends it", () => {
  receive(labels());
  setView({ model: 14 });
  ask(sketchAt([1, 2], false));
  assert.deepEqual(sent, [{ verb: "place", obj_id: 14, pixel: [1, 2] }]);
  assert.equal(state.placing, true);
  receive({ t: "error", text: "there is no depth" });
  assert.deepEqual([state.placing, state.view.model], [false, 14]);
  ask(sketchAt([2, 2], false));
  receive(labels(label(7, 0)));
  assert.deepEqual([state.placing, state.view.model], [false, null]);
});

test("steps are about the label of the object in focus, from where it was moved to", () => {
  snap();
  receive({ ...labels(label(7, 1)), frame: "0/9" }); // of a frame that is no more open
  assert.equal(labelInHand(state), null);
  receive(labels(label(6, 2), label(7, 1)));
  assert.equal(labelInHand(state).obj, 7);
  snap();
  setView({ edited: { obj: 7, arm: 0, T: poseAt(5) } });
  snap();
  snapCandidate(1);
  snapCandidate(2); // there is none
  decide(labelInHand(state), "accepted");
  assert.deepEqual(sent.map(({ verb, obj, T, state }) => [verb, obj, T?.[3] ?? state]),
    [["snap", 7, 1], ["snap", 7, 5], ["snap", 7, 9], ["decide", 7, "accepted"]]);
  setView({ preset: "inspect" });
  assert.equal(labelInHand(state), null);
});

test("a folder to label is opened in its layout, where the pose of a label has one name", () => {
  assert.deepEqual([state.view.preset, state.view.zoom], ["label", "image"]);
  assert.deepEqual(Object.keys(momentOf(state).poses), ["current", "ground truth"]);
  receive({ ...OPENED[1], id: `other ${opened}`, source: "bop" });
  assert.deepEqual([state.view.preset, state.view.zoom], ["inspect", null]);
});

test("models are chosen by parts of their names, and labels counted that need a look", () => {
  assert.deepEqual(modelsNamed(MODELS, "MUG r").map((one) => one.obj_id), [3]);
  assert.deepEqual(modelsNamed(MODELS, "14").map((one) => one.obj_id), [14]);
  const one = (labels, accepted, undecided) => ({ labels, accepted, undecided, light: "red" });
  assert.deepEqual(progressOf({ a: one(2, 0, 2), b: one(3, 2, 0), c: one(4, 1, 1), d: one(0, 0, 0) }), { labelled: 3, undecided: 3, uncertain: 3 });
});
