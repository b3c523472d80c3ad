// Why one pose scores higher than another: A and B in numbers, the stages of the iteration, and the score over the run.
import { html } from "htm/preact";
import { useMemo } from "preact/hooks";
import { useStore, setView } from "../store.js";
import { armColor, bestWords, labelOf, momentOf, rowsOf, sourceOf } from "../moment.js";
import { seek } from "../cursor.js";
import { palette, stageColor } from "../palette.js";
import { Bar, columnsOf, Icon, number, Parts, Select, Swatch, Table } from "../ui.js";
import { sidesOf } from "../sides.js";
import { Chart } from "../charts.js";

/** @import { ArmState, ScoredStage, ScoreNumbers } from "../messages.d.ts" */
/** @import { Moment, NamedPose } from "../moment.js" */
/** @import { Side } from "../sides.js" */

export const title = "Score";
export const hint = "why a pose scores as it does";
export const empty = "This object has no pose.";
export const needs = (/** @type {import("../store.js").State} */ s) => Object.keys(momentOf(s)?.poses ?? {}).length > 0;

// The parts of a pose's score: with its maps come the counts of pixels.
/** @typedef {Partial<ScoreNumbers> | NamedPose & { counts?: undefined }} Scored */
/** @type {(side: Side | null, pose: NamedPose | null) => Scored} */
const scoreOf = (side, pose) => (side?.score && !side.stale ? side.score : pose ?? {});

export function render() {
  const moment = useStore(momentOf);
  const sides = useStore((s) => sidesOf(momentOf(s)));
  const together = useStore((s) => s.view.together && momentOf(s).scene.length > 1); // all objects as one
  const [a, b, same] = together ? [sides.a?.pose, sides.b?.pose, sides.same] : [moment.a, moment.b, moment.same];
  const [of_a, of_b] = [scoreOf(sides.a, a), scoreOf(sides.b, b)];
  const names = Object.keys(moment.poses).map((name) => [name, labelOf(name, moment)]);
  const choose = (side) => (name) => setView({ a: a?.name ?? null, b: b?.name ?? null, [side]: name });
  const twice = same || !b;
  /** @type {[string, string, (s: Scored) => number | null | undefined, number, number?][]} */
  const numbers = [
    ["score", "weighted sum of the fits, 0 to 1", (s) => s.score, 3, 1],
    ["depth fit", "share of pixels whose depth agrees", (s) => s.depth_fit, 3, 1],
    ["normal fit", "share of pixels whose surface direction agrees", (s) => s.normal_fit, 3, 1],
    ["colour fit", "agreement of rendered and observed colours", (s) => s.colour_fit, 3, 1],
    ["plausibility", "1: neither floats nor sinks in, and is stable", (s) => s.plausibility, 3, 1],
    ["ADD(-S) mm", "mean distance between the model here and at ground truth", (s) => s.err, 1],
    ["turn °", "rotation against ground truth", (s) => s.deg, 1],
    ["shift mm", "translation against ground truth", (s) => s.mm, 1],
  ];
  const rows = numbers.filter(([, , of]) => of(of_a) != null || of(of_b) != null);
  /** @type {[string, NamedPose | null][]} */
  const letters = [["A", a], ["B", b]];
  /** @type {[string, Scored][]} */
  const scores = [["A", of_a], ["B", twice ? {} : of_b]];
  const counts = (/** @type {Scored} */ s) => (s.counts ? palette.classes.filter((c) => s.counts[c.name])
    .map(({ name, color }) => [name, s.counts[name], color]) : []);
  return html`<div class="tab score">
    ${together
      ? html`<p class="dim">All objects together.${letters.filter(([, pose]) => pose)
        .map(([letter, pose]) => ` ${letter}: ${pose.label}.`).join("")}</p>`
      : html`<div class="pair">
      <${Select} label="A" value=${a?.name} options=${names} onChange=${choose("a")} title=${palette.meanings[a?.name]} />
      <${Select} label="B" value=${b?.name} options=${names} onChange=${choose("b")} title=${palette.meanings[b?.name]} />
    </div>`}
    <table class="table"><thead><tr><th class="left"></th><th title=${a?.label}>A</th><th title=${b?.label}>B</th>
      <th title="B less A">B − A</th></tr></thead>
      <tbody>${rows.map(([words, meaning, of, digits, fits]) => {
        const [x, y] = [of(of_a), of(of_b)];
        const d = x != null && y != null ? Number(y.toFixed(digits)) - Number(x.toFixed(digits)) : null; // of what is shown
        const better = d == null || Math.abs(d) < 10 ** -digits / 2 ? "" : d > 0 === Boolean(fits) ? "good" : "bad";
        return html`<tr title=${meaning}><td class="left">${words}</td>
          <td>${number(x, digits)}</td><td>${number(y, digits)}</td>
          <td class=${better}>${d == null || twice ? "–" : `${d > 0 ? "+" : ""}${number(d, digits)}`}</td></tr>`;
      })}</tbody></table>
    ${twice && b && html`<p class="dim">A and B are the same pose.</p>`}
    ${scores.filter(([, s]) => counts(s).length).map(([letter, s]) => html`
      <div class="classes"><span class="dim">${letter}</span><${Parts} parts=${counts(s)} /></div>`)}
    ${(counts(of_a).length > 0 || counts(of_b).length > 0) && html`<p
      class="key">${palette.classes.map(({ name, color }) => html`
      <span><${Swatch} color=${color} />${name}</span>`)}</p>`}
    <${Stages} moment=${moment} />
    <${Curve} moment=${moment} />
  </div>`;
}

/**
 * The stages of the iteration, or of the one that made the answer; before the first, the hypotheses.
 * @param {{ moment: Moment }} props
 */
function Stages({ moment }) {
  const { isAnswer, best, run } = moment;
  const row = isAnswer ? run.rows[best?.k - 1] : moment.row;
  if (!row) return html`<${Starts} moment=${moment} />`;
  const scores = row.stages.some((s) => s.score != null);
  // What only starts the refiner is not scored.
  const shown = row.stages.filter((s) => (isAnswer || moment.poses[s.name]) && (!scores || s.score != null));
  const columns = columnsOf(shown, [
    { title: "stage", left: true, of: (s) => html`<${Swatch} color=${stageColor(s.name)} />${s.name}${
      s.name === row.accepted ? html` <span class="good" title="accepted"><${Icon} name="check" /></span>` : ""}` },
    { title: "score", of: (s) => html`<${Bar} share=${s.score} color=${stageColor(s.name)} />${number(s.score, 3)}` },
    ...(shown.some((s) => s.depth_fit != null) ? [
      { title: "depth", hint: "depth fit", of: (/** @type {ScoredStage} */ s) => number(s.depth_fit) },
      { title: "normal", hint: "normal fit", of: (/** @type {ScoredStage} */ s) => number(s.normal_fit) },
    ] : []),
    { title: "ms", of: (s) => (s.ms ? number(s.ms, 0) : "") },
  ]);
  const place = `${row.k}, hypothesis ${row.arm + 1} of ${moment.arms.length}`;
  const name = `${isAnswer ? "The answer: iteration" : "Iteration"} ${place}`;
  /** @param {ScoredStage} s */
  const choose = (s) => setView({ b: s.name, a: moment.a?.name === s.name ? "current" : moment.a?.name });
  return html`<h3>${isAnswer ? html`<button type="button" class="link" title="go there"
    onClick=${() => seek(row.k)}>${name}</button>` : name}</h3>
    <${Table} columns=${columns} rows=${shown} keyOf=${(s) => s.name} onRow=${isAnswer ? null : choose} />
    <p class="prose">${moment.isPartial ? row.stages.find((s) => s.name === moment.stage)?.text : row.text}</p>`;
}

/** @param {{ moment: Moment }} props */
function Starts({ moment }) {
  const { object, isAnswer, arms } = moment;
  const rows = arms.map((a, j) => ({ ...a, j })).sort((a, b) => (b.score ?? 0) - (a.score ?? 0));
  const columns = columnsOf(rows, [
    { title: "hypothesis", left: true, of: (a) => html`<${Swatch} color=${armColor(moment, a.j)} />${a.j + 1} <span
      class="dim">${sourceOf(moment, a.j)}</span>` },
    { title: "score", of: (a) => html`<${Bar} share=${a.score}
      color=${armColor(moment, a.j)} />${number(a.score, 3)}` },
    ...(object.has_gt ? [{ title: "mm", hint: "ADD(-S)", of: (/** @type {ArmState} */ a) => number(a.err, 1) }] : []),
  ]);
  return html`<h3>${isAnswer ? "The answer is an initial pose" : "Initial poses"}</h3>
    <${Table} columns=${columns} rows=${rows} keyOf=${(a) => a.j} current=${(a) => a.j === moment.arm}
      onRow=${(a) => setView({ arm: moment.arm === a.j ? null : a.j })} />`;
}

/** @param {{ moment: Moment }} props */
function Curve({ moment }) {
  const { run, obj, object } = moment;
  const [x, series] = useMemo(() => {
    const own = rowsOf(run, obj);
    const accepted = own.map((r) => r.stages.find((s) => s.name === r.accepted));
    return [own.map((r) => r.k), [
      { name: bestWords(moment.branch), values: own.map((r) => r.best.score), color: palette.stages.best, kind: "steps" },
      { name: "accepted", values: accepted.map((s) => s?.score ?? null), color: palette.stages.accepted, kind: "points" },
      { name: "depth fit", values: accepted.map((s) => s?.depth_fit ?? null), color: "#4aa3c7", off: true },
      { name: "normal fit", values: accepted.map((s) => s?.normal_fit ?? null), color: "#b58ad6", off: true },
      { name: "simulated", values: own.map((r) => r.stages.find((s) => s.name === "simulated")?.score ?? null),
        color: palette.stages.simulated, off: true },
      { name: "refined", values: own.map((r) => r.stages.find((s) => s.name === "refined")?.score ?? null),
        color: palette.stages.refined, off: true },
    ].filter(({ values }) => values.some((v) => v != null))];
  }, [run, obj]);
  const changed = useStore((s) => s.branches.find((b) => b.index === moment.branch)?.scored ?? []).filter((k) => k > 0);
  if (!x.length) return null;
  return html`<h3>Score of ${object.label} over the run</h3>
    <${Chart} series=${series} x=${x} yLabel="score" units="0…1" digits=${3} cursor=${moment.k || null}
      onSeek=${seek} />
    ${changed.map((k) => html`<p class="doubt">The score's settings changed after iteration ${k}: scores up to there are not comparable with later ones.</p>`)}`;
}
