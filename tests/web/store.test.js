// Wants and their answers, and messages that change what is known.
import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { answeredBy, arraysOf, forgetAnswers, listen, receive, setView, state, want } from "../../verefine_viz/page/web/store.js";

const of = (obj) => ({ what: "shaded", obj, T: [1, 0, 0, 0] });
let sent;

beforeEach(() => {
  sent = [];
  answeredBy({ send: (verb) => Boolean(sent.push(verb)), load: () => Promise.resolve(null), address: (path) => path });
  forgetAnswers();
});

const ids = () => sent.map(({ id }) => id);
const turn = () => new Promise((done) => setImmediate(done));

test("a want is sent once, and its answer stays", () => {
  assert.equal(want(of(1), "a"), undefined);
  want(of(1), "a");
  assert.equal(sent.length, 1);
  assert.deepEqual({ ...sent[0], id: "" }, { verb: "want", id: "", slot: "a", of: of(1) });
  const answer = { what: "shaded", region: [0, 0, 1, 1], url: "/blob/1" };
  receive({ t: "answer", id: ids()[0], answer });
  assert.equal(want(of(1), "a"), answer);
  assert.equal(sent.length, 1);
});

test("what lost its slot before it was answered is sent again when it is wanted again", () => {
  want(of(1), "a");
  want(of(2), "a");
  want(of(1), "a");
  assert.deepEqual(sent.map((verb) => verb.of.obj), [1, 2, 1]);
  assert.equal(ids()[0], ids()[2]); // either answer is the answer
});

test("what a lost connection did not take is sent later", () => {
  answeredBy({ send: () => false, load: () => Promise.resolve(null), address: (path) => path });
  assert.equal(want(of(1), "a"), undefined);
  answeredBy({ send: (verb) => Boolean(sent.push(verb)), load: () => Promise.resolve(null), address: (path) => path });
  want(of(1), "a");
  assert.equal(sent.length, 1);
});

test("an answer whose array is gone is asked for again", async () => {
  const maps = { what: "maps", obj: 1, T: [1] };
  want(maps, "maps");
  receive({ t: "answer", id: ids()[0], answer: { what: "maps", blob: "gone already", arrays: [] } });
  assert.equal(arraysOf(want(maps, "maps")), null);
  await turn();
  assert.equal(arraysOf(want(maps, "maps")), null);
  want(maps, "maps");
  assert.equal(sent.length, 2);
});

test("listeners are called once a frame, however much changed", async () => {
  await turn();
  let calls = 0;
  const stop = listen(() => (calls += 1));
  setView({ k: 1 });
  setView({ k: 2 });
  receive({ t: "a message of a later version" });
  await turn();
  assert.deepEqual([calls, state.view.k], [1, 2]);
  stop();
  setView({ k: 3 });
  await turn();
  assert.equal(calls, 1);
});
