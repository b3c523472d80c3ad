// A simulated grasp by a pose and by the ground truth, side by side, with its moments.
import { html } from "htm/preact";
import { useEffect } from "preact/hooks";
import { answerTo, send, setView, state, useStore } from "../store.js";
import { momentOf } from "../moment.js";
import { palette } from "../palette.js";
import { Button, number, Swatch } from "../ui.js";
import { Chart } from "../charts.js";

/** @import { GraspAnswer, GraspOutcome, Pose } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */
/** @import { State } from "../store.js" */

export const title = "Grasp";
export const hint = "would a gripper have lifted the object by this pose";
/** @param {State} s */
export const needs = (s) => Boolean(s.frame?.support) && (momentOf(s)?.scene ?? []).every((o) => o.object.has_gt) && poseOf(s) != null;
export const empty = (/** @type {State} */ s) => (!s.frame?.support ? "No support plane is known here."
  : s.frame.objects.some((o) => !o.has_gt) ? "A simulated grasp needs the ground truth of all objects." : "This object has no pose.");

/** @typedef {Exclude<keyof GraspAnswer, "what">} Side */
/** @type {[Side, string][]} */
const SIDES = [["pose", "this pose"], ["truth", "ground truth"]];
const PLAY_MS = 1000 / 30;

/** @type {(s: State) => Pose | null} */
function poseOf(s) {
  const moment = momentOf(s);
  return moment?.poses.edited?.T ?? moment?.best?.T ?? null;
}
/** @type {(moment: Moment, T: Pose) => string} */
const idOf = (moment, T) => JSON.stringify({ grasp: moment.obj, branch: moment.branch, T });

export function render() {
  const moment = useStore(momentOf);
  const [T, shown, busy] = useStore((s) => [poseOf(s), s.view.grasp, s.busy.text]);
  const id = idOf(moment, T);
  const answer = useStore(() => answerTo(id));
  useEffect(() => () => { stop(); if (state.view.grasp) setView({ grasp: null }); }, []);
  const words = moment.poses.edited ? "the edited pose" : moment.isAnswer ? "the answer" : "the best pose so far";
  const carryOut = () => send({ verb: "evaluate", id, what: "grasp", branch: moment.branch, k: moment.k, obj: moment.obj, T });
  if (!answer || "gone" in answer) {
    return html`<div class="tab grasp"><p>A gripper takes ${moment.object.label} in simulation, by the free grasp that is nearest to its middle: once by ${words}, once by the ground truth. The object is where the ground truth has it.</p>
      ${answer && "gone" in answer && html`<p class="doubt">${answer.gone}</p>`}
      <div class="row"><${Button} engine kind="primary" disabled=${Boolean(busy)} title="takes some seconds" onClick=${carryOut}>Grasp by ${words}<//></div></div>`;
  }
  const by = shown?.by ?? "pose";
  /** @param {Side} side */
  const at = (side) => Math.min(shown?.moment ?? Infinity, Math.max(answer[side].n - 1, 0)); // both show the same time
  const one = answer[by];
  const show = (next) => setView({ grasp: { by, moment: Math.max(one.n - 1, 0), ...next } });
  return html`<div class="tab grasp">
    <div class="ends">${SIDES.map(([side, name]) => {
      const end = answer[side];
      return html`<button type="button" key=${side} class=${`end ${end.good ? "good" : "bad"} ${by === side ? "on" : ""}`} title="show this grasp, in 3D as well"
          onClick=${() => setView({ grasp: { by: side, moment: Math.max(end.n - 1, 0) } })}>
        <span class="dim">by ${side === "pose" ? words : name}</span><b>${end.verdict}</b>
        ${end.n ? html`<${Picture} attempt=${end} at=${at(side)} />` : html`<span class="dim">${end.words}</span>`}
        <span class="counts"><${Swatch} color=${palette.grasps.free} />${end.free} free<${Swatch} color=${palette.grasps.blocked} />${end.blocked} blocked</span></button>`;
    })}</div>
    ${one.n > 0 && html`<${Moments} one=${one} by=${by} at=${at(by)} show=${show} />`}
  </div>`;
}

/**
 * Gripper and objects from the side; the line is the plane.
 * @param {{ attempt: GraspOutcome, at: number }} props
 */
function Picture({ attempt, at }) {
  const objects = useStore((s) => s.frame.objects);
  const obj = useStore((s) => momentOf(s)?.obj);
  const frame = attempt.frames[at];
  const line = (points) => points.map(([x, y]) => `${x},${-y}`).join(" ");
  return html`<svg class="side-view" viewBox="-160 -330 320 360">
    <line class="plane" x1="-160" x2="160" y1="0" y2="0" />
    ${[...frame.objects].sort((a, b) => Number(a[0] === obj) - Number(b[0] === obj)).map(([own, points]) => html`<polygon key=${own} class=${own === obj ? "target" : "other"} points=${line(points)}
      style=${{ fill: objects.find((o) => o.id === own)?.color, stroke: objects.find((o) => o.id === own)?.color }} />`)}
    ${frame.gripper.map((points, i) => html`<polygon class="gripper" key=${i} points=${line(points)} />`)}
    <path class="ruler" d="M-150 18h100M-150 14v8M-50 14v8" /><text x="-44" y="24">100 mm</text>
  </svg>`;
}

let timer = null; // while a grasp is played
function stop() {
  clearInterval(timer);
  timer = null;
}
function play(by, n) {
  if (timer) return stop();
  let k = state.view.grasp?.by === by && state.view.grasp.moment < n - 1 ? state.view.grasp.moment : 0;
  setView({ grasp: { by, moment: k } });
  timer = setInterval(() => {
    const now = state.view.grasp;
    if (now?.by !== by || now.moment !== k || k >= n - 1) {
      stop();
      return setView({ grasp: now });
    }
    k += 1;
    return setView({ grasp: { by, moment: k } });
  }, PLAY_MS);
  return undefined;
}

/** @param {{ one: GraspOutcome, by: "pose" | "truth", at: number, show: (next: { moment: number }) => void }} props */
function Moments({ one, by, at, show }) {
  const x = [...one.stages.keys()].map((k) => k / 30);
  const series = [
    { name: "rise mm", values: one.rise_mm, color: palette.stages.best },
    { name: "force N", values: one.force_n.map(([l, r]) => (l + r) / 2), color: "#ffbe5a" },
    { name: "gap mm", values: one.gap_mm, color: "#4aa3c7", off: true },
  ];
  const spans = one.stages.reduce((list, name, k) => (list.at(-1)?.name === name ? ((list.at(-1).n += 1), list) : [...list, { name, n: 1, k }]), []);
  const [left, right] = one.force_n[at];
  return html`
    <div class="row"><${Button} icon=${timer ? "pause" : "run"} title="play the grasp here and in 3D" onClick=${() => play(by, one.n)}>${timer ? "Pause" : "Play"}<//>
      <input type="range" min="0" max=${one.n - 1} value=${at} title="moment of the grasp" onInput=${(e) => show({ moment: Number(e.currentTarget.value) })} />
      <${Button} title="draw the grasp in 3D no more" onClick=${() => setView({ grasp: null })}>Hide<//></div>
    <div class="strip">${spans.map((s) => html`<button type="button" key=${s.k} class=${at >= s.k && at < s.k + s.n ? "on" : ""} style=${{ flex: s.n }} title=${`${s.name}, from ${(s.k / 30).toFixed(1)} s`} onClick=${() => show({ moment: s.k })}>${s.name}</button>`)}</div>
    <${Chart} series=${series} x=${x} xLabel="time [s]" yLabel="mm, N" digits=${1} cursor=${at / 30} height=${10} />
    <dl class="facts">${[["stage", one.stages[at]], ["gap", `${number(one.gap_mm[at], 0)} mm`, "between the fingers"], ["force", `${number(left, 0)} / ${number(right, 0)} N`, "of the fingers on the object, left / right"],
      ["rise", `${number(one.rise_mm[at], 0)} mm`, "of the object since the start"], ["touches", one.touches[at].join(", ") || "nothing", "what the gripper presses on"]].map(([name, value, what]) => html`
      <div title=${what}><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>
    <p class="dim">Grasps: ${one.source}.</p>`;
}
