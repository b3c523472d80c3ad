// The score around the best pose: curves along axes, a map over two of them, and poses that fit as well.
import { html } from "htm/preact";
import { useMemo, useRef, useState } from "preact/hooks";
import { setView, state, useStore } from "../store.js";
import { momentOf } from "../moment.js";
import { Button, number, Select } from "../ui.js";
import { landscapeOf } from "../wants.js";
import { colorAt, gradient } from "../colours.js";
import { palette } from "../palette.js";
import { useLatest } from "./latest.js";

/** @import { GoneAnswer, OtherAnswer, Pose, ScoreCurve, SliceAnswer } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */

export const title = "Landscape";
export const hint = "the score around the best pose";
export const needs = (/** @type {import("../store.js").State} */ s) => Boolean(momentOf(s)?.best);
export const empty = "This object has no pose.";

const FRAMES = [["table", "the table's axes"], ["object", "its own axes"]];
// Names of axes where there is little room.
/** @param {string} words */
const shortOf = (words) => words.replace("about the vertical", "about up").replace("to the camera", "to camera");

// While a run goes on its best pose changes all the time: it is scored around where that is asked for.
export function render() {
  const [now, edits] = useStore((s) => [momentOf(s), Boolean(s.view.edited)]);
  // While a pose is edited, what the tab showed before stays, to choose another one in.
  const before = useRef(null);
  const stays = edits && before.current && ["branch", "obj", "k"].every((name) => before.current[name] === now[name]);
  const moment = stays ? before.current : now;
  if (!edits) before.current = now;
  const pose = `${moment.branch} ${moment.obj} ${moment.best.arm} ${moment.best.k} ${moment.best.stage}`;
  const [asked, setAsked] = useState(null);
  const wanted = moment.isAnswer || asked === pose;
  if (!wanted) {
    return html`<div class="tab landscape"><p>How the score falls as ${moment.object.label} is moved and turned away from its best pose so far.</p>
      <div class="row"><${Button} engine kind="primary" title="takes a few seconds" onClick=${() => setAsked(pose)}>Score the poses around<//></div></div>`;
  }
  return html`<${Around} moment=${moment} pose=${pose} key=${pose} />`;
}

/** @param {{ moment: Moment, pose: string }} props */
function Around({ moment, pose }) {
  const of = landscapeOf(moment);
  const [frame, setFrame] = useState("table");
  const [axes, setAxes] = useState(/** @type {[number, number]} */ ([5, 0]));
  const around = useLatest({ ...of, part: "curves" }, "curves", pose);
  const two = useLatest(around && !("gone" in around) ? { ...of, part: "slice", axes } : null, "slice", pose);
  const other = useLatest(two ? { ...of, part: "other" } : null, "other", pose);
  if (!around) return html`<p class="empty">Scoring the poses around the ${moment.isAnswer ? "answer" : "best pose"}.</p>`;
  if ("gone" in around) return html`<p class="empty">${around.gone}</p>`;
  /** @param {Pose} T */
  const edit = (T) => state.file || setView({ obj: moment.obj, edited: { obj: moment.obj, arm: moment.best.arm, T, from: around.T } });
  const names = around.curves.map((c) => [String(c.axis), `${shortOf(c.words)} [${c.unit}]`]);
  const choose = (i) => (v) => setAxes(i === 0 ? [Number(v), axes[1]] : [axes[0], Number(v)]);
  return html`<div class="tab landscape">
    <p class="summary">${moment.isAnswer ? "Answer" : "Best pose so far"} of ${moment.object.label}: ${around.undetermined}.</p>
    <${Other} other=${other} edit=${edit} fits=${moment.verdict?.also_fits} />
    <div class="row"><h3>Score along</h3><${Select} value=${frame} options=${FRAMES} onChange=${setFrame} /></div>
    <div class="curves">${around.curves.filter((c) => c.frame === frame).map((c) => html`<${Curve} key=${c.axis} curve=${c} edit=${edit} />`)}</div>
    <p class="dim">Shaded: allowed by the image, all other motions free. Steps of the axis grow outwards.${state.file ? "" : " A click edits the pose there."}</p>
    <div class="row"><h3>Over two axes</h3></div>
    <div class="two"><div>${!two ? html`<p class="dim">Scoring.</p>` : "gone" in two ? html`<p class="dim">${two.gone}</p>` : html`<${Map} two=${two} score=${around.score} edit=${edit} />`}</div>
      <div class="axes"><${Select} label="→" value=${String(axes[0])} options=${names} onChange=${choose(0)} title="across" />
        <${Select} label="↑" value=${String(axes[1])} options=${names} onChange=${choose(1)} title="up" /></div></div>
    ${other && !("gone" in other) && html`<h3>Near symmetries</h3>${other.near.length
      ? html`<p title="mean distance between the model's surface and the turned one; depth can hardly tell such poses apart">Its shape nearly looks the same, turned by</p>
        <ul>${other.near.map((line) => html`<li>${line}</li>`)}</ul>` : html`<p class="dim">No turn leaves its shape nearly the same.</p>`}`}
  </div>`;
}

/** @param {{ other: OtherAnswer | GoneAnswer | undefined, edit: (T: Pose) => void, fits: Pose | null }} props */
function Other({ other, edit, fits }) {
  if (!other) return html`<p class="dim">Looking for another pose that fits equally well.</p>`;
  const pose = "other" in other ? other.other : null;
  if (!pose && fits) return html`<p class="doubt">Another pose explains the depth equally well: it is drawn as “fits as well”.</p>`;
  if (!pose) return html`<p class="dim">${"gone" in other ? other.gone : "No separate second pose fits as well."}</p>`;
  return html`<div class="doubt"><p><b>Also fits:</b> ${pose.words}</p>
    <div class="row"><${Button} engine title="edit this pose: see it in the image, the maps and 3D" onClick=${() => edit(pose.T)}>Edit it<//></div></div>`;
}

/**
 * One curve as SVG, its samples evenly spaced: the offsets grow outwards and would crowd in the middle.
 * @param {{ curve: ScoreCurve, edit: (T: Pose) => void }} props
 */
function Curve({ curve, edit }) {
  const [at, setAt] = useState(null);
  const { offsets, scores } = curve;
  const n = offsets.length;
  const [W, H] = [120, 44];
  const x = (i) => ((i + 0.5) / n) * W;
  const y = (s) => H - 3 - Math.max(0, Math.min(1, s)) * (H - 6);
  // The place of an offset between the samples.
  const place = (value) => {
    const i = Math.max(0, Math.min(n - 2, offsets.findLastIndex((o) => o <= value)));
    const t = offsets[i + 1] > offsets[i] ? (value - offsets[i]) / (offsets[i + 1] - offsets[i]) : 0;
    return x(i + Math.max(0, Math.min(1, t)));
  };
  const [from, to] = [place(curve.low), place(curve.high)];
  const line = scores.map((s, i) => `${x(i).toFixed(1)},${y(s).toFixed(1)}`).join(" ");
  const find = (e) => {
    const { left, width } = e.currentTarget.querySelector("svg").getBoundingClientRect();
    return Math.max(0, Math.min(n - 1, Math.floor(((e.clientX - left) / width) * n)));
  };
  const digits = (v) => `${Math.abs(v) < 10 ? +v.toFixed(1) : v.toFixed(0)}`.replace("-", "−");
  const ticks = [0, 0.25, 0.5, 0.75, 1].map((share) => Math.round(share * (n - 1)));
  return html`<figure onPointerMove=${(e) => setAt(find(e))} onPointerLeave=${() => setAt(null)} onClick=${(e) => edit(curve.poses[find(e)])}
      title=${`${curve.words}: undetermined within ${curve.width}`}>
    <figcaption><span>${shortOf(curve.words)}, ${curve.unit}</span><b>${curve.width}</b></figcaption>
    <div class="scores"><span title="score">1</span><span title="score">0</span></div>
    <svg viewBox=${`0 0 ${W} ${H}`} preserveAspectRatio="none">
      <rect class="undetermined" x=${from} y="0" width=${Math.max(to - from, 0.6)} height=${H} />
      ${offsets.map((o, i) => html`<line class=${o === 0 ? "middle" : ticks.includes(i) ? "tick" : "step"} x1=${x(i)} x2=${x(i)} y1=${o === 0 || ticks.includes(i) ? 0 : H - 4} y2=${H} />`)}
      <polyline points=${line} />
      ${at != null && html`<line class="at" x1=${x(at)} x2=${x(at)} y1="0" y2=${H} />`}
    </svg>
    <div class="ends">${at == null ? ticks.map((i) => html`<span style=${{ left: `${(100 * (i + 0.5)) / n}%` }}>${digits(offsets[i])}</span>`)
      : html`<b>${offsets[at] > 0 ? "+" : ""}${digits(offsets[at])} ${curve.unit}: ${number(scores[at], 3)}</b>`}</div>
  </figure>`;
}

/** @param {{ two: SliceAnswer, score: number, edit: (T: Pose) => void }} props */
function Map({ two, score, edit }) {
  const [at, setAt] = useState(null);
  const { scores, across, up, poses } = two;
  const n = scores.length;
  const [low, high] = useMemo(() => [Math.min(...scores.flat()), Math.max(...scores.flat())], [scores]);
  const share = (s) => (high > low ? (s - low) / (high - low) : 1);
  const cells = useMemo(() => scores.flatMap((row, r) => row.map((s, c) => html`
    <rect x=${c} y=${n - 1 - r} width="1.02" height="1.02" fill=${colorAt("viridis", share(s))} />`)), [scores]);
  const find = (e) => {
    const box = e.currentTarget.getBoundingClientRect();
    const cell = (v, size) => Math.max(0, Math.min(n - 1, Math.floor((v / size) * n)));
    return [n - 1 - cell(e.clientY - box.top, box.height), cell(e.clientX - box.left, box.width)];
  };
  const end = (v, unit) => `${v > 0 ? "+" : ""}${Math.abs(v) < 10 ? +v.toFixed(1) : v.toFixed(0)}${unit === "°" ? "" : " "}${unit}`.replace("-", "−");
  const middle = (n - 1) / 2;
  return html`<div class="map"><div class="up" title=${up.words}><span>${end(up.offsets.at(-1), up.unit)}</span><span>${shortOf(up.words)}</span><span>${end(up.offsets[0], up.unit)}</span></div>
    <svg viewBox=${`0 0 ${n} ${n}`} onPointerMove=${(e) => setAt(find(e))} onPointerLeave=${() => setAt(null)} onClick=${(e) => { const [r, c] = find(e); edit(poses[r][c]); }}>
      ${cells}<path d=${`M${middle + 0.1} ${middle + 0.5}h0.8M${middle + 0.5} ${middle + 0.1}v0.8`} />
      ${at && html`<rect class="at" x=${at[1]} y=${n - 1 - at[0]} width="1" height="1" />`}</svg>
    <div class="scale"><span>${number(high, 2)}</span><i style=${{ background: gradient(palette.scales.viridis, "top") }} /><span>${number(low, 2)}</span></div>
    <div class="across"><span>${end(across.offsets[0], across.unit)}</span><span>${shortOf(across.words)}</span><span>${end(across.offsets.at(-1), across.unit)}</span></div>
    <div class="read">${at ? html`${end(across.offsets[at[1]], across.unit)}, ${end(up.offsets[at[0]], up.unit)}: <b>${number(scores[at[0]][at[1]], 3)}</b>` : html`<span class="dim">here ${number(score, 3)}</span>`}</div></div>`;
}
