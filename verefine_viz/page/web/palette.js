// Colours, names and limits that mean something, as the program sends them in the message `hello`: core/palette.py.

/** @import { HelloMessage, Palette } from "./messages.d.ts" */

/** @type {Palette} */
export const palette = {
  stages: {}, meanings: {}, marks: {}, classes: [], sides: {}, side_lines: {}, scene: {}, axes: ["#f00", "#0f0", "#00f"], grasps: {}, motions: {}, causes: [],
  runs: [], times: {}, ranks: {}, scales: {}, empty: "#000000",
};
export const limits = { correct: 0.1 }; // below this share of the diameter a pose is right
export const limitWords = () => `${100 * limits.correct} % of the diameter`;
/** @param {HelloMessage} hello */
export function learn(hello) {
  Object.assign(palette, hello.palette);
  limits.correct = hello.correct;
}

// The colour of a stage; of one that has none its own, that of "current".
/** @param {string} name */
export const stageColor = (name) => palette.stages[name] ?? palette.stages.current;

// Hypotheses are coloured by rank, 0 = the lowest, 1 = the highest.
/** @type {(share: number, theme?: string) => string} */
export function rampColor(share, theme = document.documentElement.dataset.theme) {
  const [low, high] = palette.ranks[theme === "light" ? "light" : "dark"];
  const t = Math.max(0, Math.min(1, share));
  const [h, s, l] = low.map((x, i) => x + (high[i] - x) * t);
  return `hsl(${h.toFixed(0)} ${s.toFixed(0)}% ${l.toFixed(0)}%)`;
}
