// Errors against ground truth: over the run, by stage, and of every hypothesis.
import { html, useMemo } from "../vendor/htm-preact.js";
import { useStore, setView } from "../store.js";
import { bestWords, labelOf, momentOf, rowsOf, seek, sourceOf, STAGE_COLORS } from "../moment.js";
import { number, Swatch, Table } from "../ui.js";
import { Chart } from "../charts.js";

export const title = "Errors";
export const hint = "errors against ground truth";
export const empty = "No ground truth for this object.";
export const needs = (s) => Boolean(momentOf(s)?.object.has_gt);

const error = (limit) => (p) => html`<span
  class=${p.err == null ? "" : p.err < limit ? "good" : "bad"}>${number(p.err, 1)}</span>`;

export function render() {
  const moment = useStore(momentOf);
  const { object, poses, obj, best } = moment;
  const limit = object.diameter_mm / 10;
  const stages = Object.entries(poses).filter(([name, p]) => p.err != null && name !== "ground truth")
    .map(([name, p]) => ({ ...p, name }));
  const of_stage = [
    { title: "pose", left: true, of: (p) => html`<${Swatch}
      color=${STAGE_COLORS[p.name]} />${labelOf(p.name, moment)}` },
    { title: "ADD(-S) mm", hint: `right below ${number(limit, 1)} mm, 10 % of the diameter`, of: error(limit) },
    { title: "turn °", of: (p) => number(p.deg, 1) },
    { title: "shift mm", of: (p) => number(p.mm, 1) },
    { title: "score", of: (p) => number(p.score) },
    { title: "ms", of: (p) => (p.ms ? number(p.ms, 0) : "") },
  ].filter((c) => c.title !== "ms" || stages.some((p) => p.ms));
  const { starts } = moment;
  const arms = moment.arms.map((a, j) => ({ ...a, j, start: starts[j] ?? {} }));
  const of_arm = [
    { title: "hypothesis", left: true, of: (a) => html`<${Swatch}
      color=${a.j === best?.arm ? STAGE_COLORS.best : "transparent"} hollow />${a.j + 1} <span
        class="dim">${sourceOf(moment, a.j)}</span>` },
    { title: "initial mm", hint: "ADD(-S) of its initial pose", of: (a) => error(limit)(a.start) },
    { title: "now mm", hint: "ADD(-S) of its current pose", of: error(limit) },
    { title: "score", of: (a) => number(a.score) },
    { title: "plays", of: (a) => number(a.plays, 0) },
  ];
  return html`<div class="tab errors">
    <${Curve} moment=${moment} limit=${limit} />
    <h3>${moment.isAnswer || !moment.row ? "Poses" : `Iteration ${moment.row.k}`}</h3>
    <${Table} columns=${of_stage} rows=${stages} keyOf=${(p) => p.name} />
    <h3>${arms.length} hypotheses</h3>
    <${Table} columns=${of_arm} rows=${arms} keyOf=${(a) => a.j} current=${(a) => a.j === moment.arm}
      onRow=${(a) => setView({ obj, arm: moment.arm === a.j ? null : a.j })} />
  </div>`;
}

function Curve({ moment, limit }) {
  const { run, obj } = moment;
  const [x, series] = useMemo(() => {
    const own = rowsOf(run, obj);
    const stage = (r, name) => r.stages.find((s) => s.name === name);
    return [own.map((r) => r.k), [
      { name: bestWords(moment.branch), values: own.map((r) => r.best.err), color: STAGE_COLORS.best, kind: "steps" },
      { name: "accepted", values: own.map((r) => stage(r, r.accepted)?.err ?? null), color: STAGE_COLORS.accepted,
        kind: "points" },
      { name: "turn °", values: own.map((r) => stage(r, r.accepted)?.deg ?? null), color: "#b58ad6", off: true },
      { name: "shift mm", values: own.map((r) => stage(r, r.accepted)?.mm ?? null), color: "#4aa3c7", off: true },
    ]];
  }, [run, obj]);
  if (!x.length) return null;
  return html`<h3>ADD(-S) of ${moment.object.label} over the run</h3>
    <${Chart} series=${series} x=${x} yLabel="error" units="mm" digits=${1} cursor=${moment.k || null} onSeek=${seek}
      lines=${[{ y: limit, name: `10 % of the diameter, ${number(limit, 1)} mm` }]} />`;
}
