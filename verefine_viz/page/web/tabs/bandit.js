// The bandit as it was when it chose: mean and bonus of every hypothesis; passes of a scene; the tree of a tree search.
import { html } from "htm/preact";
import { useMemo, useState } from "preact/hooks";
import { send, setView, state, useStore } from "../store.js";
import { armColor, momentOf, rowsOf } from "../moment.js";
import { seek } from "../cursor.js";
import { limits, palette } from "../palette.js";
import { Button, number, Select, Swatch } from "../ui.js";
import { Chart } from "../charts.js";
import { settingsOf } from "./setting.js";
import { Tree, treeAt } from "./tree.js";

/** @import { ArmChoice, IterationRow } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */

export const title = "Bandit";
export const hint = "which hypothesis was chosen, and why";
export const needs = (/** @type {import("../store.js").State} */ s) => {
  const moment = momentOf(s);
  return moment != null && (moment.arms.length > 1 || moment.run.rows.some((row) => row.scene || row.tree));
};
export const empty = (/** @type {import("../store.js").State} */ s) => (momentOf(s).arms.length
  ? "There is one hypothesis, so nothing is chosen." : "This object has no hypothesis to choose from.");

const ORDERS = [["index", "in their order"], ["ucb", "by UCB"], ["plays", "by calls"], ["err", "by error"]];
const MOST_CURVES = 8;

export function render() {
  const moment = useStore(momentOf);
  const tree = useMemo(() => treeAt(moment.run.rows, moment.k, moment.object.cluster - 1), [moment.run, moment.k, moment.object]);
  return html`<div class="tab bandit">${tree
    ? html`<${Tree} tree=${tree} moment=${moment} />`
    : html`<${Arms} moment=${moment} /><${Curves} moment=${moment} />`}
    <${Passes} moment=${moment} /></div>`;
}

/**
 * The iteration whose choice is shown; the bandit's numbers are those from before it.
 * @param {Moment} moment
 */
function choiceOf(moment) {
  const { row, isAnswer, run, obj } = moment;
  const shown = isAnswer ? rowsOf(run, obj).at(-1) : row;
  return { shown, choice: shown?.choice ?? null };
}

/**
 * @param {Moment} moment
 * @param {ArmChoice | null} choice
 * @param {IterationRow | undefined} shown
 */
function armsOf(moment, choice, shown) {
  const { starts } = moment;
  return moment.arms.map((arm, j) => ({
    j,
    plays: choice ? choice.plays[j] : arm.plays,
    mean: choice ? choice.mean[j] : arm.mean,
    bonus: choice ? choice.bonus[j] : null,
    ucb: choice ? choice.ucb[j] : null,
    err: arm.err,
    start: starts[j],
    chosen: shown?.arm === j,
  }));
}

/** @param {{ moment: Moment }} props */
function Arms({ moment }) {
  const [order, setOrder] = useState("index");
  const branches = useStore((s) => s.branches);
  const settings = useMemo(() => settingsOf(state, moment.branch), [branches, moment.branch]);
  const { shown, choice } = choiceOf(moment);
  const arms = armsOf(moment, choice, shown);
  const key = { index: (a) => a.j, ucb: (a) => -(a.ucb ?? a.mean ?? 0), plays: (a) => -a.plays, err: (a) => a.err ?? Infinity }[order];
  arms.sort((a, b) => key(a) - key(b) || a.j - b.j);
  const top = Math.max(1e-9, ...arms.map((a) => (a.mean ?? 0) + (Number.isFinite(a.bonus) ? a.bonus : 0)));
  const limit = limits.correct * moment.object.diameter_mm;
  const know = arms.some((a) => a.err != null);
  const fades = arms.some((a) => a.plays % 1); // older plays count less
  const orders = ORDERS.filter(([id]) => (id === "err" ? know : id === "ucb" ? choice : true));
  const width = (x) => ({ width: `${(100 * Math.max(0, Math.min(x, top))) / top}%` });
  const c = /** @type {number | undefined} */ (settings.find((one) => one.name === "method.exploration")?.value);
  return html`
    <p class="summary">${wordsOf(moment, shown, choice)}</p>
    <div class="row"><span class="key"><span><i class="swatch mean" />mean</span>${choice && html`<span><i class="swatch bonus" />bonus</span>`}
      <span><i class="chosen-mark" />chosen</span></span><span class="spring" />
      ${arms.length > 2 && html`<${Select} value=${order} options=${orders} onChange=${setOrder} title="order of the hypotheses" />`}</div>
    <table class=${`table bandit-arms ${arms.length > 12 ? "many" : ""}`}><thead><tr>
      <th class="left" title="hypothesis; a click puts it in focus">#</th>
      <th class="left wide" title=${choice ? "mean of the rewards + bonus of the exploration, as they were when the bandit chose" : "mean of the rewards"}>${choice ? "mean + bonus" : "mean"}</th>
      ${choice && html`<th title="upper confidence bound: mean + bonus; the highest is chosen">UCB</th>`}
      <th title=${fades ? "n of the bandit: its initial pose and its calls before this choice; older ones count less"
        : "calls of the refiner before this choice, and the one that was chosen; n of the bandit is one more, for the initial pose"}>${fades ? "n" : "calls"}</th>
      ${know && html`<th title=${`ADD(-S) of its latest pose, which need not be the answer; right below ${number(limit, 1)} mm`}>mm now</th>`}</tr></thead>
    <tbody>${arms.map((a) => html`<tr key=${a.j} class=${`clickable ${a.j === moment.arm ? "current" : ""} ${a.chosen ? "chosen" : ""}`}
      onClick=${() => setView({ obj: moment.obj, arm: moment.arm === a.j ? null : a.j })}
      title=${`hypothesis ${a.j + 1}${a.start?.source ? ` from ${a.start.source}` : ""}: mean ${number(a.mean, 3)}${choice ? ` + bonus ${number(a.bonus, 3)}` : ""}`}>
      <td class="left"><${Swatch} color=${armColor(moment, a.j)} />${a.j + 1}</td>
      <td class="left wide"><span class="ucb"><i class="mean" style=${width(a.mean)} /><i class="bonus" style=${width(Number.isFinite(a.bonus) ? a.bonus : 0)} /></span></td>
      ${choice && html`<td>${number(a.ucb, 3)}</td>`}
      <td>${fades ? number(a.plays, 1) : Math.max(0, a.plays - 1)}${!fades && choice && a.chosen ? " + 1" : ""}</td>
      ${know && html`<td class=${a.err == null ? "" : a.err < limit ? "good" : "bad"}>${number(a.err, 1)}</td>`}
    </tr>`)}</tbody></table>
    ${choice && arms.length > 1 && c != null && arms.some((a) => a.bonus > 0) && html`<div class="row"><span class="dim">What if c, the bonus's weight, were</span>
      ${[0, Math.max(2 * c, 0.05), Math.max(4 * c, 0.1)].filter((v) => v !== c).map((v) => html`<${Button} engine title="a new branch from the start, run to its end"
        onClick=${() => send({ verb: "fork", branch: moment.branch, k: 0, changes: { "method.exploration": v }, run: true })}>${+v.toPrecision(2)}<//>`)}
      <span class="dim">instead of ${+c.toPrecision(3)}?</span></div>`}`;
}

/**
 * @param {Moment} moment
 * @param {IterationRow | undefined} shown
 * @param {ArmChoice | null} choice
 */
function wordsOf(moment, shown, choice) {
  if (choice) {
    const words = choice.reason.replace(/\barm (\d+)/g, "hypothesis $1");
    return html`Iteration ${shown.k} took ${words}.`;
  }
  if (!shown) return "Nothing was chosen yet. These are the scores of the initial poses.";
  const alone = rowsOf(moment.run, moment.obj).every((row) => row.arm === shown.arm);
  return `The method does not choose by rewards: ${alone ? "it works on one hypothesis alone" : "it takes the hypotheses in turn"}.`;
}

/** @param {{ moment: Moment }} props */
function Curves({ moment }) {
  const [what, setWhat] = useState("ucb");
  const { run, obj, object, arm } = moment;
  const [x, series] = useMemo(() => {
    const own = rowsOf(run, obj);
    const chosen = own.filter((row) => row.choice);
    if (!chosen.length) return [[], []];
    const last = own.at(-1);
    const n = last.arms.length;
    const sorted = [...last.arms.keys()].sort((i, j) => last.arms[j].plays - last.arms[i].plays || i - j);
    const shown = new Set(sorted.slice(0, MOST_CURVES));
    if (arm < n) shown.add(arm);
    return [chosen.map((row) => row.k), [...shown].sort((i, j) => i - j).map((j) => ({
      name: `${j + 1}`,
      values: chosen.map((row) => (Number.isFinite(row.choice[what][j]) ? row.choice[what][j] : null)),
      color: armColor({ run, object }, j),
      kind: what === "plays" ? "steps" : "line",
    }))];
  }, [run, obj, what, arm]);
  if (x.length < 2) return null;
  return html`<div class="row"><h3>Over the run, ${object.label}</h3><span class="spring" />
    <${Select} value=${what} options=${[["ucb", "UCB"], ["mean", "mean"], ["bonus", "bonus"], ["plays", "n"]]} onChange=${setWhat} /></div>
    <${Chart} key=${what} series=${series} x=${x} yLabel=${{ ucb: "UCB", plays: "n" }[what] ?? what} digits=${what === "plays" ? 0 : 3} cursor=${moment.k || null} onSeek=${seek} />
    ${moment.arms.length > series.length && html`<p class="dim">The ${series.length} hypotheses that were played most, and the one in focus.</p>`}`;
}

/**
 * Passes over all objects of a cluster: how well they fit together.
 * @param {{ moment: Moment }} props
 */
function Passes({ moment }) {
  const { run, object } = moment;
  const rows = useMemo(() => run.rows.filter((row) => row.scene && row.cluster === object.cluster), [run, object]);
  const [x, series] = useMemo(() => [rows.map((row) => row.k), [
    { name: "incumbent", values: rows.map((r) => r.scene.incumbent), color: palette.stages.best, kind: "steps" },
    { name: "best known", values: rows.map((r) => r.scene.best_known), color: palette.stages.simulated, kind: "line" },
    { name: "this pass", values: rows.map((r) => r.scene.score), color: palette.stages.current, kind: "line" },
    { name: "reward", values: rows.map((r) => r.scene.reward), color: "#b58ad6", kind: "points", off: true },
  ]], [rows]);
  if (!rows.length) return null;
  const last = rows.findLast((r) => r.k <= moment.k);
  return html`<h3>Passes over ${object.cluster > 1 ? `cluster ${object.cluster}` : "the objects"}</h3>
    <${Chart} series=${series} x=${x} yLabel="scene score" units="0…1" digits=${3} cursor=${moment.k || null} onSeek=${(k) => seek(nearest(x, k))} />
    ${last && html`<dl class="facts">
      ${[["pass", last.scene.number, "closed by the cursor"], ["its score", number(last.scene.score, 3), "all objects at the poses of this pass, rendered together"],
         ["best known", number(last.scene.best_known, 3), "the best pose of each object, rendered together"],
         ["reward", number(last.scene.reward, 3), "what the hypotheses of this pass were credited with"],
         ["incumbent", number(last.scene.incumbent, 3), "the best scene so far: the answer"]].map(([name, value, what]) => html`
        <div title=${what}><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>`}`;
}

const nearest = (xs, k) => xs.reduce((best, x) => (Math.abs(x - k) < Math.abs(best - k) ? x : best), xs[0]);
