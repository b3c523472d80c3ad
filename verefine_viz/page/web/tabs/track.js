// The object over the frames of a sequence: how its pose changes from frame to frame, and how well it is known.
import { html } from "htm/preact";
import { send, state, useStore } from "../store.js";
import { momentOf } from "../moment.js";
import { palette } from "../palette.js";
import { columnsOf, number, Swatch, Table } from "../ui.js";
import { useLatest } from "./latest.js";

/** @import { TrackAnswer, TrackFrame } from "../messages.d.ts" */
/** @typedef {Exclude<keyof TrackFrame, "frame" | "kind">} Measured */

export const title = "Track";
export const hint = "the object over the frames of a sequence";
/** @param {import("../store.js").State} s */
export const needs = (s) => (s.frame?.frames.length ?? 0) > 1 && momentOf(s) != null;
export const empty = "One frame: no sequence.";

const MOST_COLUMNS = 160;
const [BAR, GAP] = [46, 8];

export function render() {
  const moment = useStore(momentOf);
  const frame = useStore((s) => s.frame);
  const answer = useLatest({ what: "track", obj: moment.obj, done: moment.over }, "track", String(moment.obj));
  if (!answer) return html`<p class="empty">Comparing the frames.</p>`;
  if ("gone" in answer) return html`<p class="empty">${answer.gone}</p>`;
  if (answer.frames.length < 2) return html`<p class="empty">Solve two frames of this sequence and ${moment.object.label} is followed from one to the next.</p>`;
  const odd = answer.frames.filter((f) => f.kind === "flip" || f.kind === "jump");
  const open = (/** @type {TrackFrame} */ f) => f.frame !== state.frame.frame && send({ verb: "open", frame: f.frame });
  return html`<div class="tab track">
    <p class="summary">${answer.words}</p>
    <${Strip} answer=${answer} here=${frame.frame} open=${open} />
    <dl class="legend">${Object.entries(palette.motions).map(([kind, color]) => html`<div><dt><${Swatch} color=${color} />${kind}</dt><dd class="dim">${answer.legend[kind]}</dd></div>`)}</dl>
    <p class="dim">Motions are relative to ${answer.reference === "world" ? "the world: what the camera does is left out" : "the camera: what the camera does is in them"}.</p>
    <h3>${odd.length ? "Flips and jumps" : "Frames"}</h3>
    <${Table} rows=${odd.length ? odd : answer.frames.slice(0, 60)} keyOf=${(f) => f.frame} onRow=${open} current=${(f) => f.frame === frame.frame} columns=${columnsOf(answer.frames, [
      { title: "frame", left: true, of: (f) => html`<${Swatch} color=${palette.motions[f.kind]} />${f.frame} <span class="dim">${f.kind === "moved" ? "" : f.kind}</span>` },
      { title: "moved mm", of: (f) => (f.kind === "no pose" ? "–" : number(f.moved_mm, 1)) },
      { title: "turned °", of: (f) => (f.kind === "no pose" ? "–" : number(f.turned_deg, 1)) },
      { title: "score", of: (f) => number(f.score) },
      { title: "mm", hint: "ADD(-S) against ground truth", of: (f) => number(f.err, 1) },
      { title: "± mm", hint: "how far the answer may be shifted without the score telling", of: (f) => number(f.undetermined_mm, 1) },
    ]).filter((c, i) => i < 3 || answer.frames.some((f, j) => c.of(f, j) !== "–"))} />
  </div>`;
}

/**
 * Rows of bars over the frames, each with its axis; of more frames than columns each column shows the largest.
 * @param {{ answer: TrackAnswer, here: string, open: (f: TrackFrame) => void }} props
 */
function Strip({ answer, here, open }) {
  const { frames, jump_mm, jump_deg } = answer;
  const per = Math.ceil(frames.length / MOST_COLUMNS);
  const columns = Array.from({ length: Math.ceil(frames.length / per) }, (_, i) => frames.slice(i * per, (i + 1) * per));
  const W = 320;
  const w = W / columns.length;
  /** @type {Partial<Record<TrackFrame["kind"], number>>} */
  const ranks = { jump: 2e6, flip: 1e6 };
  const rank = (/** @type {TrackFrame} */ f) => ranks[f.kind] ?? 0;
  /** @param {TrackFrame[]} list */
  const worst = (list) => list.reduce((a, b) => (rank(b) + b.moved_mm / jump_mm + b.turned_deg / jump_deg > rank(a) + a.moved_mm / jump_mm + a.turned_deg / jump_deg ? b : a));
  /** @param {Measured} key */
  const largest = (key) => (/** @type {TrackFrame[]} */ list) => Math.max(...list.map((f) => f[key] ?? -1));
  /** @param {Measured} key */
  const least = (key) => (/** @type {TrackFrame[]} */ list) => Math.min(...list.map((f) => f[key] ?? Infinity));
  const bound = (/** @type {Measured} */ key, /** @type {number} */ at_least) => Math.max(at_least, ...frames.filter((f) => f.kind === "moved").map((f) => f[key] ?? 0));
  const rows = [
    { name: "moved", unit: "mm", top: Math.min(jump_mm, bound("moved_mm", 5)), of: largest("moved_mm"), kind: true },
    { name: "turned", unit: "°", top: Math.min(jump_deg, bound("turned_deg", 5)), of: largest("turned_deg"), kind: true },
    { name: "score", unit: "", top: 1, of: least("score"), color: palette.stages.best },
    { name: "their score", unit: "", top: Math.max(1e-9, ...frames.map((f) => f.recorded_score ?? 0)), of: least("recorded_score"), color: palette.stages.edited },
    { name: "error", unit: "mm", top: Math.max(1, ...frames.map((f) => f.err ?? 0)), of: largest("err"), color: palette.motions.jump },
    { name: "undetermined", unit: "mm", top: 30, of: largest("undetermined_mm"), color: "#967bbe" },
    { name: "no depth", unit: "share", top: 1, of: largest("missing_depth"), color: "#aa8c5a" },
  ].filter((row) => columns.some((c) => row.of(c) >= 0 && Number.isFinite(row.of(c))));
  /** @param {TrackFrame} f */
  const words = (f) => `frame ${f.frame}: ${f.kind === "no pose" ? "no pose" : `${f.moved_mm.toFixed(1)} mm, ${f.turned_deg.toFixed(1)}°${f.kind === "moved" ? "" : ` (${f.kind})`}`}${
    f.lifted_mm != null ? `; on the table ${f.lifted_mm.toFixed(1)} mm, ${f.tilted_deg.toFixed(1)}°` : ""}${f.score != null ? `; score ${f.score.toFixed(2)}` : ""}${
    f.undetermined_mm != null ? `; undetermined by ${f.undetermined_mm.toFixed(0)} mm, ${f.undetermined_deg.toFixed(0)}°` : ""}`;
  const H = rows.length * (BAR + GAP);
  return html`<div class="frames-strip"><div class="names">${rows.map((row) => html`<div><span>${row.name}</span><span class="dim">${+row.top.toPrecision(2)} ${row.unit}</span></div>`)}</div>
    <svg viewBox=${`0 0 ${W} ${H}`} preserveAspectRatio="none" style=${{ height: `${rows.length * 3.6}rem` }}>
      ${rows.map((row, r) => html`<line class="floor" x1="0" x2=${W} y1=${r * (BAR + GAP) + BAR} y2=${r * (BAR + GAP) + BAR} />
        ${columns.map((c, i) => {
          const value = row.of(c);
          if (!(value >= 0) || !Number.isFinite(value)) return null;
          const h = Math.max(1, BAR * Math.min(1, value / row.top));
          return html`<rect x=${i * w + 0.1 * w} width=${0.8 * w} y=${r * (BAR + GAP) + BAR - h} height=${h} fill=${row.kind ? palette.motions[worst(c).kind] : row.color} />`;
        })}`)}
      ${columns.map((c, i) => html`<rect class=${`hit ${c.some((f) => f.frame === here) ? "here" : ""}`} x=${i * w} width=${w} y="0" height=${H} onClick=${() => open(worst(c))}><title>${words(worst(c))}</title></rect>`)}
    </svg>
    <div class="ends"><span>${frames[0].frame}</span><span>frame</span><span>${frames.at(-1).frame}</span></div></div>`;
}
