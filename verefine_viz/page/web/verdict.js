// The verdict bar: what is open, what came of it and why; what is shown, and the link to it.
import { html } from "htm/preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { addressOf, state, useStore, setView, send, update } from "./store.js";
import { editWords, isLabelled, momentOf, runOf, worstOf } from "./moment.js";
import { goTo } from "./film.js";
import { limitWords } from "./palette.js";
import { DoubtBadges } from "./doubt_card.js";
import { Button, counted, Icon, IconButton, Menu, MenuItem, number } from "./ui.js";
import { neighbour, openAnswer } from "./answers.js";
import { Failures } from "./gallery.js";
import { addKeys, nameToOpen, titled } from "./keys.js";
import { copyLink } from "./address.js";
import { presets, setPreset, switchTheme } from "./layout.js";

/** @import { FrameMessage, JudgedObject, Open, TitledSession, VerdictMessage } from "./messages.d.ts" */
/** @import { Moment } from "./moment.js" */

const failureBeside = (/** @type {1 | -1} */ by) => (state.answers ? neighbour(state, by) : null);
addKeys([
  { id: "failure", keys: ["j"], title: "Next failure of the batch", group: "Move", when: () => failureBeside(1) != null,
    action: () => openAnswer(failureBeside(1)) },
  { id: "failure-back", keys: ["k"], title: "Failure before", group: "Move", when: () => failureBeside(-1) != null,
    action: () => openAnswer(failureBeside(-1)) },
]);

const TONES = {
  right: ["check", "Right"], wrong: ["cross", "Wrong"], doubt: ["warn", "Doubtful"],
    unknown: ["question", "No ground truth"],
  none: ["cross", "No pose"], going: ["dot", ""],
};
const limitHint = () => "ADD(-S), the mean distance between the model at this pose and at the true one. "
  + `A pose is right below ${limitWords()}.`;

const share = () => send({ verb: "save", what: "share", branch: state.view.branch });

export function Verdict() {
  const [frame, moment, preset, theme] = useStore((s) => [s.frame, momentOf(s), s.view.preset, s.theme]);
  return html`<header class="verdict">
    <${Opener} frame=${frame} />
    ${moment ? html`<${Words} moment=${moment} />` : html`<span class="spring" />`}
    <${Failures} />
    <nav class="presets" aria-label="Layout">${presets(state).map((p) => html`
      <${Button} on=${p.id === preset}
        title=${`${p.hint}${p.id === "gallery" ? " (G)" : ""}${p.id === preset ? "; click: sizes as designed" : ""}`}
        onClick=${() => setPreset(p.id)}>${p.title}<//>`)}</nav>
    <div class="group">
      <${IconButton} icon="chain" title="Copy a link to this frame, object and iteration" onClick=${copyLink} />
      ${!state.file && html`<${IconButton} icon="share" onClick=${share}
        title="Share: this page as one HTML file that opens offline, without the program" />`}
      <${IconButton} icon="search" title=${titled("palette")} onClick=${() => update({ overlay: "palette" })} />
      <${IconButton} icon=${theme === "light" ? "moon" : "sun"} title=${titled("theme")} onClick=${switchTheme} />
      <${IconButton} icon="help" title=${titled("help")} onClick=${() => update({ overlay: "help" })} />
    </div>
  </header>`;
}

/**
 * The frame, and what can be opened instead.
 * @param {{ frame: FrameMessage | null }} props
 */
function Opener({ frame }) {
  const settings = useStore((s) => s.branches.find((b) => b.index === s.view.branch)?.settings);
  if (!frame) return html`<div class="opener"><b>${state.report?.title ?? "verefine-viz"}</b></div>`;
  const { "method.name": method = frame.method, "method.refiner": refiner = frame.refiner } = settings ?? {};
  const label = frame.choices.methods.find((m) => m.name === method)?.label ?? frame.method_label;
  const detail = [frame.frame, label, method === "trace" ? "" : refiner].filter(Boolean).join(" · ");
  return html`<div class="opener">
    <${Menu} kind="opener-button" title=${`${frame.title}; click: ${state.file ? "the command that opens it in the program" : "open another frame, demo or session"}`} label=${html`
      <span class="two"><b>${frame.title}</b>
      <span class="dim">${detail}</span></span><${Icon} name="down" />`}>
      ${(close) => state.file ? html`<div class="open-list"><p>${state.file.command}</p></div>`
        : html`<${OpenList} frame=${frame} close=${close} />`}
    <//>
  </div>`;
}

/**
 * Of a built-in scene a small picture, of others the sign of a folder.
 * @param {{ demo: string }} props
 */
const ScenePicture = ({ demo }) => (demo
  ? html`<img class="scene-picture" src=${addressOf(`/web/demos/${demo}.webp`)} alt="" loading="lazy" />`
  : html`<i class="scene-picture"><${Icon} name="folder" /></i>`);

const TO_LABEL = "Label these frames";

/**
 * Whether frames of a folder lack ground truth, which can be made.
 * @param {FrameMessage} frame
 */
const canBeLabelled = ({ source, objects }) => ["bop", "folder"].includes(source) && !objects.some((o) => o.has_gt);

/**
 * What can be opened: by a click, or by typing a part of its name until one is left and Enter.
 * @param {{ frame: FrameMessage, close: () => void }} props
 */
function OpenList({ frame, close }) {
  const [text, setText] = useState("");
  const input = useRef(null);
  useEffect(() => input.current.focus(), []);
  /**
   * @template T
   * @param {string} title
   * @param {T[]} list
   * @param {(one: T) => Omit<Open, "verb">} verb
   * @param {(one: T) => boolean} on
   * @returns {[string, any[], (one: any) => Omit<Open, "verb">, (one: any) => boolean]}
   */
  const listed = (title, list, verb, on) => [title, list, verb, on];
  const all = [
    listed("Frames", frame.frames, (f) => ({ frame: f }), (f) => f === frame.frame),
    listed("Demos", frame.demos ?? [], (d) => ({ demo: d }), (d) => frame.source === "demo" && d === frame.dataset),
    listed("Sessions", frame.sessions ?? [], (s) => ({ session: s.path }), (s) => s.path === frame.session_file),
  ];
  const lists = all.filter(([, list]) => list.length > 1 || (list.length && list !== frame.frames));
  const titleOf = (/** @type {string | TitledSession} */ one) => (typeof one === "string" ? one : one.title);
  /** @type {(one: string | TitledSession, list: (string | TitledSession)[]) => string} */
  const words = (one, list) => nameToOpen(titleOf(one), list.map(titleOf));
  const fits = (w) => w.toLowerCase().includes(text.toLowerCase());
  const file = /\.(toml|vfrun|rrd)$/i.exec(text.trim())?.[1].toLowerCase();
  /** @param {Omit<Open, "verb">} what */
  const open = (what) => { close(); send({ verb: "open", ...what }); };
  const typed = text.trim();
  const ofFile = file && { [file === "toml" ? "session" : "recording"]: typed };
  const fitting = lists.map(([title, list, verb, on]) => ({ title, on, verb,
    entries: list.map((one) => ({ one, words: words(one, list) })).filter((entry) => fits(entry.words)) }));
  const left = fitting.flatMap(({ verb, entries }) => entries.map(({ one }) => verb(one)));
  const enter = (/** @type {KeyboardEvent} */ e) => {
    if (e.key === "Enter" && ofFile) open(ofFile);
    else if (e.key === "Enter" && left.length === 1) open(left[0]);
  };
  return html`<div class="open-list"><input ref=${input} placeholder="filter, or the path of a file" value=${text} spellcheck=${false}
      onInput=${(e) => setText(e.currentTarget.value)} onKeyDown=${enter} />
    <div class="scroll">${ofFile && html`<${MenuItem} onClick=${() => open(ofFile)}>
        Open the ${file === "toml" ? "session" : "recording"} ${typed}<//>`}
      ${canBeLabelled(frame) && fits(TO_LABEL) && html`<${MenuItem} onClick=${() => open({ label: true })}>${TO_LABEL}<//>`}
      ${fitting.filter(({ entries }) => entries.length).map(({ title, on, verb, entries }) => html`<h3>${title}</h3>
        ${entries.map((entry) => html`<${MenuItem} on=${on(entry.one)} onClick=${() => open(verb(entry.one))}>${
          title !== "Frames" && html`<${ScenePicture} demo=${typeof entry.one === "string" ? entry.one : entry.one.demo} />`}${entry.words}<//>`)}`)}
      ${!ofFile && !left.length && html`<p class="dim">nothing by that name</p>`}
    </div></div>`;
}

/** @param {{ moment: Moment }} props */
function Words({ moment }) {
  const [verdict, chosen] = useStore((s) => [s.verdicts.get(s.view.branch), s.view.obj]);
  if (!verdict?.objects.length || state.view.edited) return html`<${Going} moment=${moment} />`;
  const outcome = (chosen != null && verdict.objects.find((o) => o.obj === chosen))
    || verdict.objects.find((o) => o.obj === moment.obj)
    || worstOf(verdict);
  const several = verdict.objects.length > 1;
  const [icon, word] = TONES[outcome.tone] ?? TONES.unknown;
  const findings = verdict.objects.reduce((n, o) => n + (o.findings?.length ?? 0), 0) + (verdict.doubts?.length ?? 0);
  const label = state.frame.objects.find((o) => o.id === outcome.obj)?.label;
  return html`<div class=${`words ${outcome.tone}`}>
    <div class="first">
      <span class="badge"><${Icon} name=${icon} />${word}</span>
      <${DoubtBadges} moment=${moment} />
      ${several && html`<b class="name">${label}</b>`}
      ${outcome.err != null ? html`<span class="figure"
        title=${limitHint()}><b>${number(outcome.err, 1)} mm</b> of ${number(outcome.limit, 1)} allowed</span>` : ""}
      ${outcome.score != null && html`<span class="figure"
        title="score of the answer, in 0 to 1">score <b>${number(outcome.score)}</b></span>`}
      ${outcome.also_fits && html`<span class="also"
        title="another pose explains the depth equally well; both are drawn">also fits elsewhere</span>`}
      <${Why} verdict=${verdict} first=${outcome.obj} n=${findings} />
    </div>
    <div class="second">${moment.isAnswer ? html`${several && verdict.scene?.words ? html`<span
      class="scene">${verdict.scene.words}</span>` : ""}<span title=${outcome.words}>${capital(outcome.words)}</span>`
      : html`<${Here} moment=${moment} />`}</div>
  </div>`;
}

/**
 * Below the verdict, what happened at the cursor.
 * @param {{ moment: Moment }} props
 */
function Here({ moment }) {
  const { head, words, text } = goingWords(moment);
  return html`<span title=${text}><b>${head}</b> ${words}</span>`;
}

/**
 * What happened at the cursor.
 * @param {Moment} moment
 */
function goingWords(moment) {
  const { k, row, isCurrent, stage, stages, arms, object, best } = moment;
  const text = stage ? row.stages.find((s) => s.name === stage)?.text : row?.text;
  const place = stage && `stage ${stages.indexOf(stage) + 1} of ${stages.length}: ${stage}`;
  const edited = state.view.edited;
  let words = edited ? `the pose of hypothesis ${edited.arm + 1} of ${object.label} is being edited`
    : `works on another object; ${object.label} is shown as it is by now`;
  if (k === 0 && isLabelled(state.frame)) {
    const moved = edited ? " is being moved" : best?.score != null ? `, score ${number(best.score)}` : "";
    return { head: "Label", words: `${object.label}${moved}`, text };
  }
  if (k === 0) {
    const n = state.frame.objects.length;
    words = `${n > 1 ? `${n} objects` : object.label}, ${counted(arms.length, "hypothesis", "hypotheses")}`;
    if (best?.score != null) words += `, best initial score ${number(best.score)}`;
  } else if (isCurrent && !edited) words = stage ? `hypothesis ${row.arm + 1} of ${arms.length} · ${place}` : row.brief;
  return { head: k ? `Iteration ${k}` : moment.over ? "Before iteration 1" : "Ready", words, text };
}

/**
 * While nothing is decided.
 * @param {{ moment: Moment }} props
 */
function Going({ moment }) {
  const edits = useStore((s) => s.branches.find((b) => b.index === moment.branch)?.edits) ?? [];
  const first = moment.k ? [] : edits.filter((e) => e.k === 0).map((e) => editWords(e, state.frame.objects));
  const { head, words, text } = goingWords(moment);
  return html`<div class="words going" title=${text}>
    <div class="first"><${DoubtBadges} moment=${moment} /><b>${head}</b> <span>${words}</span></div>
    <div class="second">${(moment.over && moment.run.missing) || text || first.join("; ") || moment.object.left_out || ""}</div>
  </div>`;
}

/** @param {JudgedObject} o */
const numbers = (o) => [
  o.err != null && `${number(o.err, 1)} mm of ${number(o.limit, 1)} allowed`,
  o.deg != null && `${number(o.deg, 1)}°${o.way && o.deg >= 1 ? ` (${o.way})` : ""}, ${number(o.mm, 1)} mm off`,
  o.score != null && `score ${number(o.score, 3)}`,
  o.score != null && `hypothesis ${o.arm + 1}, ${o.k ? `iteration ${o.k}` : "an initial pose"}`,
].filter(Boolean).join(" · ");
const capital = (text) => (text ? text[0].toUpperCase() + text.slice(1) : "");

// What is shown of an iteration: of the last one what it did, not the answer.
const stageAt = (/** @type {number} */ k) => (k === runOf(state).rows.length ? runOf(state).rows[k - 1].stages.at(-1).name : null);

/** @param {{ verdict: VerdictMessage, first: number, n: number }} props */
function Why({ verdict, first, n }) {
  const frame = useStore((s) => s.frame);
  const objects = [...verdict.objects].sort((a, b) => Number(b.obj === first) - Number(a.obj === first));
  const shown = new Set(verdict.objects.flatMap((o) => (o.findings ?? []).map((f) => f.text)));
  const doubts = [...new Set([...(verdict.doubts ?? []).map((d) => `${d.text}.`), ...(verdict.notes ?? [])])].filter((text) => !shown.has(text));
  const label = (id) => frame.objects.find((o) => o.id === id)?.label;
  return html`<${Menu} kind="why" title="Evidence and what to do about it" label=${n ? `why (${n})` : "why"}>
    ${(close) => html`<div class="findings scroll">
      ${verdict.scene?.words && verdict.objects.length > 1 && html`<p class="dim">${verdict.scene.words}</p>`}
      ${objects.map((o) => html`<section key=${o.obj} class=${o.tone}>
        <h3 onClick=${() => { close(); setView({ obj: o.obj, arm: null }); }} title="show this object">
          <${Icon} name=${(TONES[o.tone] ?? TONES.unknown)[0]} />${label(o.obj)}
          <span class="dim">${numbers(o)}</span></h3>
        ${!(o.findings?.length) && o.words && html`<p>${capital(o.words)}.</p>`}
        ${(o.findings ?? []).map((f) => html`<article>
          <h4>${capital(f.title)}</h4><p>${f.text}</p>${f.advice && html`<p class="dim">${capital(f.advice)}.</p>`}
          <div class="group">
            ${f.k != null && f.k > 0 && html`<${Button} title="go there"
              onClick=${() => { close(); goTo(o.obj, { k: f.k, stage: stageAt(f.k), tab: f.tab_there }); }}>Iteration ${f.k}<//>`}
            ${f.tab && html`<${Button} title="the picture that shows it" onClick=${() => { close(); setView({ obj: o.obj, arm: null, tab: f.tab }); }}>Show<//>`}
            ${f.try && html`<${Button} engine title=${`a new branch from the start with ${wordsOf(f.try)}`} onClick=${() => {
              close();
              send({ verb: "fork", branch: state.view.branch, k: 0, changes: f.try, run: true });
            }}>Try ${wordsOf(f.try)}<//>`}
          </div></article>`)}
      </section>`)}
      ${doubts.length > 0 && html`<section><h3>Data</h3>${doubts.map((d) => html`<p>${d}</p>`)}</section>`}
    </div>`}
  <//>`;
}

const wordsOf = (changes) =>
  Object.entries(changes).map(([name, v]) => `${name.split(".").pop().replaceAll("_", " ")} = ${v}`).join(", ");
