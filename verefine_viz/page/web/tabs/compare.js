// Two runs of the same frame: where they part, who comes nearer, and all branches.
import { html } from "htm/preact";
import { useMemo, useState } from "preact/hooks";
import { send, setView, state, useStore } from "../store.js";
import { momentOf, rowsOf, runOf, startsOf, verdictOf } from "../moment.js";
import { Button, columnsOf, IconButton, number, Select, Table } from "../ui.js";
import { Chart } from "../charts.js";
import { palette } from "../palette.js";
import { useLatest } from "./latest.js";
import { putBeside, runBeside, runBoth } from "./beside.js";
import { Field, listOf, longName, parsed, settingsOf, shortName, shown } from "./setting.js";

/** @import { BestPose, BranchListed, CompareAnswer, ComparedAnswer, ComparedBranches, EditableSetting, InitialPose, JudgedObject, ObjectInBoth, RunDeparture } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */
/** @import { Run } from "../store.js" */

export const title = "Compare";
export const hint = "two runs side by side, and all branches";
export const needs = (/** @type {import("../store.js").State} */ s) => s.branches.length > 0;
export const empty = "No run is open.";

const MOST_LISTED = 4;
const Letter = ({ side }) => html`<b class="side" style=${{ color: `var(--side-${side})` }}>${side.toUpperCase()}</b>`;

export function render() {
  const [compare, branches, branch] = useStore((s) => [s.compare, s.branches, s.view.branch, s.runs.get(s.compare?.a), s.runs.get(s.compare?.b)]);
  const moment = useStore(momentOf);
  return html`<div class="tab compare">
    ${compare ? html`<${Pair} compare=${compare} branches=${branches} moment=${moment} />` : html`<p class="summary">Put another run of this frame beside this one.</p>`}
    <${NewB} branch=${compare?.a ?? branch} branches=${branches} compare=${compare} />
    <${Branches} branches=${branches} moment=${moment} compare=${compare} />
  </div>`;
}

/** @param {{ compare: ComparedBranches, branches: BranchListed[], moment: Moment }} props */
function Pair({ compare, branches, moment }) {
  const { a, b } = compare;
  const [run_a, run_b, running] = useStore((s) => [runOf(s, a), runOf(s, b), s.running.branch]);
  const answer = useLatest({ what: "compare", a, b, done: [run_a.rows.length, run_b.rows.length] }, "compare", `${a} ${b}`);
  const result = answer && !("gone" in answer) ? answer : null;
  const options = branches.map((one) => [String(one.index), one.name]);
  const choose = (side) => (index) => {
    const to = { ...compare, [side]: Number(index) };
    if (to.a !== to.b) send({ verb: "compare", a: to.a, b: to.b, run: false });
  };
  const go = (/** @type {RunDeparture} */ { a: k_a, b: k_b, place }) => {
    const obj = result.pairs[place - 1]?.[0] ?? null;
    setView({ branch: a, k: k_a ?? 0, beside: k_b ?? 0, obj, stage: null, arm: null, edited: null });
  };
  const left = [run_a, run_b].some((run) => !run.over);
  return html`
    <div class="sides">
      <${Letter} side="a" /><${Select} value=${String(a)} options=${options} onChange=${choose("a")} title="A" /><span class="dim">${run_a.rows.length} of ${run_a.total}</span>
      <${Letter} side="b" /><${Select} value=${String(b)} options=${options} onChange=${choose("b")} title="B" /><span class="dim">${run_b.rows.length} of ${run_b.total}</span>
    </div>
    <div class="row">
      <${Button} engine title="A becomes B" onClick=${() => { send({ verb: "compare", a: b, b: a, run: false }); setView({ branch: b, k: Math.min(state.view.beside ?? state.view.k, run_b.rows.length), beside: state.view.k }); }}>Swap<//>
      <${Button} engine title="show one run alone again; B stays as a branch" onClick=${() => { send({ verb: "compare", a, stop: true, run: false }); setView({ beside: null }); }}>End A/B<//>
      ${left && running == null && html`<${Button} engine kind="primary" title="compute what is left of A and of B" onClick=${runBoth}>Run both<//>`}
      ${running != null && html`<span class="dim">${running === a ? "A" : running === b ? "B" : "Another branch"} is computed.</span>`}
    </div>
    ${result && html`
      <p class="summary">${result.words}</p>
      ${result.departures.length > 0 && html`<div class="row">${result.departures.filter((d, i, all) => all.findIndex((x) => x.place === d.place) === i).map((d) => html`
        <${Button} title=${`B ${d.text}`} onClick=${() => go(d)}>${d.kind === "score" ? "First other score" : "First difference"}: ${d.place ? `iteration ${d.a ?? d.b}` : "the start"}<//>`)}</div>`}
      ${!result.scores_alike && html`<p class="doubt">A and B score by different settings: their scores do not compare, errors do.</p>`}
      <${Outcomes} answer=${result} moment=${moment} />
      <${Curves} run_a=${run_a} run_b=${run_b} moment=${moment} names=${result.names} compare=${compare} />
      ${result.settings.length > 0 && html`<h3>Settings that differ</h3><table class="table"><thead><tr><th class="left">setting</th><th>A</th><th>B</th></tr></thead>
        <tbody>${result.settings.map(([name, x, y]) => html`<tr title=${name}><td class="left">${shortName(name)}</td><td>${x}</td><td>${y}</td></tr>`)}</tbody></table>`}`}`;
}

/** @param {{ answer: CompareAnswer, moment: Moment }} props */
function Outcomes({ answer, moment }) {
  /** @type {(o: ObjectInBoth, of: (x: ComparedAnswer) => number | null, digits: number) => unknown} */
  const pair = (o, of, digits) => html`${number(o.a && of(o.a), digits)}<span class="dim"> → </span>${number(o.b && of(o.b), digits)}`;
  const know = answer.rows.some((o) => o.a?.err != null || o.b?.err != null);
  const columns = columnsOf(answer.rows, [
    { title: "answers, A → B", left: true, of: (o) => o.name },
    { title: "score", hint: answer.scores_alike ? "verification score" : "each by the settings of its own run: they do not compare", of: (o) => pair(o, (x) => x.score, 3) },
    { title: "mm", hint: "ADD(-S) against ground truth", of: (o) => html`<span title=${`turned ${number(o.a?.deg, 1)}° → ${number(o.b?.deg, 1)}°, shifted ${number(o.a?.mm, 1)} → ${number(o.b?.mm, 1)} mm`}>${pair(o, (x) => x.err, 1)}</span>` },
    { title: know ? "nearer" : "higher", hint: know ? "which is nearer to ground truth" : "which scores higher",
      of: (o) => (o.winner == null ? "–" : o.winner === "even" ? "=" : html`<${Letter} side=${o.winner.toLowerCase()} />`) },
  ]).filter((c) => know || c.title !== "mm");
  const { a, b } = answer.effort;
  /** @type {[string, number, number, number][]} */
  const efforts = [["iterations", a.iterations, b.iterations, 0], ["refiner calls", a.refiner_calls, b.refiner_calls, 0], ["in roll-outs", a.rollout_calls, b.rollout_calls, 0], ["time s", a.ms / 1000, b.ms / 1000, 2]];
  const effort = efforts.filter(([, x, y]) => x || y);
  return html`<${Table} columns=${columns} rows=${answer.rows} keyOf=${(/** @type {ObjectInBoth} */ o) => o.obj} onRow=${(/** @type {ObjectInBoth} */ o) => setView({ obj: o.obj, arm: null })} current=${(/** @type {ObjectInBoth} */ o) => answer.rows.length > 1 && o.obj === moment.obj} />
    <dl class="facts">${answer.frame && html`<div title="how well all answers together explain the frame"><dt>frame score</dt><dd>${number(answer.frame[0], 3)} → ${number(answer.frame[1], 3)}</dd></div>`}
      ${effort.map(([name, x, y, digits]) => html`<div><dt>${name}</dt><dd>${number(x, digits)} → ${number(y, digits)}</dd></div>`)}</dl>`;
}

/** @param {{ run_a: Run, run_b: Run, moment: Moment, names: [string, string], compare: ComparedBranches }} props */
function Curves({ run_a, run_b, moment, names, compare }) {
  const { obj, object } = moment;
  const [what, setWhat] = useState(/** @type {"score" | "err"} */ ("score"));
  const [x, series, own_a, own_b] = useMemo(() => {
    const sides = [run_a, run_b].map((run) => {
      const starts = startsOf(run, object);
      const first = starts.reduce((best, s) => ((s.score ?? 0) > (best?.score ?? -1) ? s : best), /** @type {InitialPose | null} */ (null));
      return { own: rowsOf(run, obj), values: [first?.[what] ?? null, ...rowsOf(run, obj).map((r) => r.best[what])] };
    });
    const n = Math.max(...sides.map((s) => s.values.length));
    const line = ({ values }) => [...Array(n).keys()].map((i) => values[i] ?? null);
    return [[...Array(n).keys()], [
      { name: `A ${names[0]}`, values: line(sides[0]), color: palette.side_lines.A, kind: "steps" },
      { name: `B ${names[1]}`, values: line(sides[1]), color: palette.side_lines.B, kind: "steps", dash: true },
    ], sides[0].own, sides[1].own];
  }, [run_a, run_b, obj, object, what, names]);
  if (x.length < 2) return null;
  const here = moment.branch === compare.b ? own_b : own_a;
  const go = (n) => {
    const at = (own) => (n <= 0 ? 0 : own[Math.min(n, own.length) - 1]?.k ?? 0);
    const [k, beside] = moment.branch === compare.b ? [at(own_b), at(own_a)] : [at(own_a), at(own_b)];
    setView({ k, beside, obj, stage: null, arm: null });
  };
  return html`<div class="row"><h3>Best pose of ${object.label} so far</h3><span class="spring" />
      ${object.has_gt && html`<${Select} value=${what} options=${[["score", "score"], ["err", "error"]]} onChange=${setWhat} />`}</div>
    <${Chart} key=${what} series=${series} x=${x} xLabel="iteration of this object" yLabel=${what === "score" ? "score" : "ADD(-S)"} units=${what === "score" ? "0…1" : "mm"}
      digits=${what === "score" ? 3 : 1} cursor=${here.filter((r) => r.k <= moment.k).length} onSeek=${go} />`;
}

/**
 * What B can be: this frame with a changed setting, another branch, or a recording.
 * @param {{ branch: number, branches: BranchListed[], compare: ComparedBranches | null }} props
 */
function NewB({ branch, branches, compare }) {
  const { preset, choices } = state.frame;
  /** @type {EditableSetting[]} */
  const settings = [...settingsOf(state, branch), { name: "preset", kind: "choice", value: preset, standard: preset, choices: choices.presets, common: true, can_fork: false, help: "every choice as recommended, as in the paper's text, or as in the authors' code" }];
  const [name, setName] = useState("method.name");
  const [value, setValue] = useState(null);
  const [typed_name, setTypedName] = useState(/** @type {string | null} */ (null)); // while it names no setting
  const [path, setPath] = useState("");
  const setting = settings.find((one) => one.name === name) ?? settings[0];
  if (!setting) return null;
  const now = value ?? setting.value;
  const typed = setting.kind === "int" || setting.kind === "float" ? parsed(setting, String(now)) : now;
  const same = typed === undefined || typed === setting.value;
  const others = branches.filter((b) => b.index !== branch && b.index !== compare?.b);
  const pick = (/** @type {string} */ text) => {
    const one = settings.find((s) => longName(s.name) === text);
    setTypedName(one ? null : text);
    if (one) setName(one.name), setValue(null);
  };
  return html`<section class="new-b"><h3>${compare ? "Another B" : "B is"}</h3>
    <div class="form-row"><span class="dim">this frame with</span>
      <input type="text" list="settings-of-b" class="name" value=${typed_name ?? longName(name)} title=${setting.help || "type a part of its name"} spellcheck=${false}
        onFocus=${(e) => { setTypedName(""); e.currentTarget.value = ""; }} onInput=${(e) => pick(e.currentTarget.value)} onBlur=${() => setTypedName(null)} />
      <datalist id="settings-of-b">${settings.map((one) => html`<option value=${longName(one.name)} />`)}</datalist>
      <${Field} setting=${setting} value=${now} onChange=${setValue} />
      <${Button} engine kind="primary" disabled=${same} title=${same ? "choose another value than A's" : `${listOf({ [name]: typed })}, from the start; A is run too where it is not`}
        onClick=${() => { runBeside(branch, { [name]: typed }); setValue(null); }}>Run B<//>${same && html`<span class="dim">A has ${shown(setting.value)}: choose another</span>`}</div>
    ${others.length > 0 && html`<div class="form-row"><span class="dim">the branch</span>
      ${others.map((b) => html`<${Button} engine title="put this branch beside A" onClick=${() => putBeside(branch, { b: b.index })}>${b.name}<//>`)}</div>`}
    <div class="form-row"><span class="dim">a recording</span>
      <input type="text" placeholder="path of a .vfrun or .rrd of this frame" value=${path} onInput=${(e) => setPath(e.currentTarget.value)} />
      <${Button} engine title="put the recorded run beside A" disabled=${!path.trim()} onClick=${() => putBeside(branch, { recording: path.trim() })}>Open as B<//></div>
  </section>`;
}

// Settings in a few words: a preset stands for all that it sets.
/** @param {Record<string, unknown>} settings */
function fewOf({ preset, ...others }) {
  if (preset) return listOf({ preset });
  const names = Object.keys(others);
  return `${listOf(Object.fromEntries(names.slice(0, MOST_LISTED).map((name) => [name, others[name]])))}${names.length > MOST_LISTED ? `, ${names.length - MOST_LISTED} more` : ""}`;
}

/** @param {{ branches: BranchListed[], moment: Moment, compare: ComparedBranches | null }} props */
function Branches({ branches, moment, compare }) {
  const [renamed, setRenamed] = useState(null);
  const nameOf = (/** @type {number} */ index) => branches.find((b) => b.index === index)?.name ?? "–";
  /** @type {(index: number, key: keyof JudgedObject & keyof BestPose) => any} */
  const bestOf = (index, key) => verdictOf(state, moment.obj, index)?.[key] ?? runOf(state, index).rows.findLast((r) => r.obj === moment.obj)?.best[key] ?? null;
  /** @type {(b: BranchListed, name: string) => void} */
  const rename = (b, name) => {
    setRenamed(null);
    if (name.trim() && name !== b.name) send({ verb: "branch", index: b.index, name: name.trim() });
  };
  const here = branches.find((b) => b.index === moment.branch);
  /** @param {BranchListed | undefined} b */
  const scoreOf = (b) => JSON.stringify(Object.entries(b?.settings ?? {}).filter(([name]) => name.startsWith("score.")));
  /** @param {BranchListed} b */
  const sideOf = (b) => (b.index === compare?.a ? html`<${Letter} side="a" /> ` : b.index === compare?.b ? html`<${Letter} side="b" /> ` : "");
  /** @param {BranchListed} b */
  const origin = (b) => [b.recording ? "recording" : b.parent != null ? `left ${nameOf(b.parent)} after ${b.from}` : "", fewOf(b.settings)].filter(Boolean).join(", ");
  const columns = columnsOf(branches, [
    { title: "branch", left: true, of: (b) => (renamed === b.index
      ? html`<input type="text" value=${b.name} maxlength="80" ref=${(e) => e && document.activeElement !== e && e.focus()} onClick=${(e) => e.stopPropagation()}
          onKeyDown=${(e) => (e.key === "Enter" ? rename(b, e.currentTarget.value) : e.key === "Escape" && setRenamed(null))} onBlur=${(e) => rename(b, e.currentTarget.value)} />`
      : html`<div class="branch-name" title=${[...new Set([b.name, origin(b)])].filter(Boolean).join(": ")}><div>${sideOf(b)}${b.name}</div><div class="dim">${origin(b) === b.name ? "" : origin(b)}</div></div>`) },
    { title: "done", of: (b) => `${runOf(state, b.index).rows.length}/${runOf(state, b.index).total}` },
    { title: "score", hint: `of the best pose of ${moment.object.label}`, of: (b) => html`${number(bestOf(b.index, "score"), 3)}${
      scoreOf(b) === scoreOf(here) ? "" : html` <span title="scored by other settings than the branch that is shown: not comparable">⚠</span>`}` },
    { title: "mm", hint: `ADD(-S) of the best pose of ${moment.object.label}`, of: (b) => number(bestOf(b.index, "err"), 1) },
    { title: "", of: (b) => html`<span class="acts" onClick=${(e) => e.stopPropagation()}>
      ${branches.length > 1 && html`<${IconButton} engine icon="close" title="remove this branch" onClick=${() => send({ verb: "branch", index: b.index, remove: true })} />`}</span>` },
  ]).filter((c) => c.title !== "mm" || moment.object.has_gt);
  return html`<div class="row"><h3>${branches.length === 1 ? "The only branch" : `${branches.length} branches`}</h3><span class="spring" />
      <${Button} title="give the branch that is shown another name" onClick=${() => setRenamed(moment.branch)}>Rename<//></div>
    <${Table} columns=${columns} rows=${branches} keyOf=${(b) => b.index} current=${(b) => b.index === moment.branch}
      onRow=${(b) => setView({ branch: b.index, k: moment.isAnswer ? runOf(state, b.index).rows.length : Math.min(moment.k, runOf(state, b.index).rows.length), stage: null, arm: null, edited: null })} />`;
}
