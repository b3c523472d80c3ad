// Errors against ground truth: over the run, by stage, and of every hypothesis.
import { html } from "htm/preact";
import { useMemo } from "preact/hooks";
import { useStore } from "../store.js";
import { bestWords, labelOf, momentOf, rowsOf } from "../moment.js";
import { seek } from "../cursor.js";
import { limits, limitWords, palette, stageColor } from "../palette.js";
import { columnsOf, number, Swatch, Table } from "../ui.js";
import { Chart } from "../charts.js";
import { Calls, LedAway, Starts } from "./hypothesis_errors.js";

/** @import { IterationRow, ScoredStage } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */

export const title = "Errors";
export const hint = "errors against ground truth";
export const empty = "No ground truth for this object.";
export const needs = (/** @type {import("../store.js").State} */ s) => Boolean(momentOf(s)?.object.has_gt);

/** @type {(limit: number) => (p: { err?: number | null }) => unknown} */
const error = (limit) => (p) => html`<span
  class=${p.err == null ? "" : p.err < limit ? "good" : "bad"}>${number(p.err, 1)}</span>`;

export function render() {
  const moment = useStore(momentOf);
  const { object, poses } = moment;
  const limit = limits.correct * object.diameter_mm;
  // What only starts the refiner has no score.
  const scores = Object.entries(poses).some(([name, p]) => name !== "ground truth" && p.score != null);
  const stages = Object.entries(poses).filter(([name, p]) => p.err != null && name !== "ground truth" && (!scores || p.score != null))
    .map(([name, p]) => ({ ...p, name }));
  const of_stage = columnsOf(stages, [
    { title: "pose", left: true, of: (p) => html`<${Swatch}
      color=${stageColor(p.name)} />${labelOf(p.name, moment)}` },
    { title: "mm", hint: `ADD(-S), right below ${number(limit, 1)} mm, ${limitWords()}`, of: error(limit) },
    { title: "turn °", of: (p) => number(p.deg, 1) },
    { title: "shift mm", of: (p) => number(p.mm, 1) },
    { title: "score", of: (p) => number(p.score, 3) },
    { title: "ms", of: (p) => (p.ms ? number(p.ms, 0) : "") },
  ]).filter((c) => c.title !== "ms" || stages.some((p) => p.ms));
  return html`<div class="tab errors">
    <${Calls} moment=${moment} limit=${limit} />
    <${LedAway} moment=${moment} />
    <${Starts} moment=${moment} />
    <${Curve} moment=${moment} limit=${limit} />
    <h3>${moment.isAnswer || !moment.row ? "Poses" : `Iteration ${moment.row.k}`}</h3>
    <${Table} columns=${of_stage} rows=${stages} keyOf=${(p) => p.name} />
  </div>`;
}

/** @param {{ moment: Moment, limit: number }} props */
function Curve({ moment, limit }) {
  const { run, obj } = moment;
  const [x, series] = useMemo(() => {
    const own = rowsOf(run, obj);
    /** @type {(r: IterationRow, name: string) => ScoredStage | undefined} */
    const stage = (r, name) => r.stages.find((s) => s.name === name);
    return [own.map((r) => r.k), [
      { name: bestWords(moment.branch), values: own.map((r) => r.best.err), color: palette.stages.best, kind: "steps" },
      { name: "accepted", values: own.map((r) => stage(r, r.accepted)?.err ?? null), color: palette.stages.accepted,
        kind: "points" },
      { name: "turn °", values: own.map((r) => stage(r, r.accepted)?.deg ?? null), color: "#b58ad6", off: true },
      { name: "shift mm", values: own.map((r) => stage(r, r.accepted)?.mm ?? null), color: "#4aa3c7", off: true },
    ]];
  }, [run, obj]);
  if (!x.length) return null;
  return html`<h3>ADD(-S) of ${moment.object.label} over the run</h3>
    <${Chart} series=${series} x=${x} yLabel="error" units="mm" digits=${1} cursor=${moment.k || null} onSeek=${seek}
      lines=${[{ y: limit, name: `${limitWords()}, ${number(limit, 1)} mm` }]} />`;
}
