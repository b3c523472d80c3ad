// A run as the server sends it, of one object with two hypotheses: iterations as `row(k)`.

// The pose of a camera-parallel object, moved by x along the x-axis.
export const poseAt = (x) => [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1];

const stage = (name, x, score) => ({ name, T: poseAt(x), score, err: x, ms: 1, text: name });
const arm = (x, score) => ({ T: poseAt(x), score, err: x, plays: 1, mean: score, source: "a" });

export const row = (k) => ({
  k, obj: 7, arm: 0, n: k, own: k, pass: null, accepted: "refined", events: [], placed: [], tree: null,
  stages: [stage("current", 50 - k, 0.1), stage("simulated", 49.5 - k, 0.2), stage("refined", 49 - k, 0.3)],
  best: { score: 0.1 * k + 0.1, err: 49 - k, arm: 0, k, stage: "refined", T: poseAt(49 - k) },
  arms: [arm(49 - k, 0.1 * k + 0.1), arm(60, 0.05)], brief: "", text: "",
});

const arms = [arm(50, 0.1), arm(60, 0.05)];
const object = { id: 7, obj_id: 7, label: "mug", diameter_mm: 100, has_gt: true, gt: poseAt(0), arms };
const choices = { methods: [{ name: "rir", verifies: true }] };

// Some of the colours that the program sends.
const palette = {
  scales: { viridis: [[68, 1, 84], [253, 231, 37]], inferno: [[0, 0, 4], [120, 20, 60], [252, 255, 164]],
    blue_red: [[33, 102, 172], [178, 24, 43]], magenta_green: [[197, 27, 125], [77, 146, 33]] },
  classes: ["explained", "missed", "protruding", "hidden", "unknown"]
    .map((name, i) => ({ name, color: `#${(i + 1) * 111111}`, words: name })),
};
export const HELLO = { t: "hello", window: 1, version: "1", palette, correct: 0.1 };

// What comes when a frame is opened; ends with a run of no iteration.
export const OPENED = [
  HELLO,
  { t: "frame", id: 1, title: "", frame: "0/0", method: "rir", choices, objects: [object] },
  { t: "branches", list: [{ index: 0, name: "first run", edits: [], settings: {} }], compare: null },
  { t: "run", branch: 0, from: 0, total: 5, over: false, rows: [], marks: [] },
];
