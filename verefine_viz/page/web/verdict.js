// The verdict bar: what is open, what came of it and why; what is shown, and the link to it.
import { html, useState } from "./vendor/htm-preact.js";
import { state, useStore, setView, send, update } from "./store.js";
import { editWords, momentOf, seek, worstOf } from "./moment.js";
import { Button, Icon, IconButton, Menu, MenuItem, number } from "./ui.js";
import { Failures, neighbour, openAnswer } from "./gallery.js";
import { addKeys, nameToOpen, titled } from "./keys.js";
import { copyLink } from "./messages.js";
import { presets, setPreset, switchTheme } from "./layout.js";

const failureBeside = (by) => (state.answers ? neighbour(state, by) : null);
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
const LIMIT = "ADD(-S), the mean distance between the model at this pose and at the true one. "
  + "A pose is right below 10 % of the diameter.";

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

// The frame, and what can be opened instead.
function Opener({ frame }) {
  const [text, setText] = useState("");
  if (!frame) return html`<div class="opener"><b>${state.report?.title ?? "verefine-viz"}</b></div>`;
  const lists = [
    ["Frames", frame.frames, (f) => ({ frame: f }), (f) => f === frame.frame],
    ["Demos", frame.demos ?? [], (d) => ({ demo: d }), (d) => frame.source === "demo" && d === frame.dataset],
    ["Sessions", frame.sessions ?? [], (s) => ({ session: s.path }), (s) => s.path === frame.session_file],
  ].filter(([, list]) => list.length > 1 || (list.length && list !== frame.frames));
  const words = (one, list) => nameToOpen(one.title ?? one, list.map((other) => other.title ?? other));
  const fits = ([, w]) => w.toLowerCase().includes(text.toLowerCase());
  const file = /\.(toml|vfrun|rrd)$/i.exec(text.trim())?.[1].toLowerCase();
  const refiner = frame.method === "trace" ? "" : frame.refiner;
  const detail = [frame.frame, frame.method_label, refiner].filter(Boolean).join(" · ");
  return html`<div class="opener">
    <${Menu} kind="opener-button" title=${`${frame.title}; click: ${state.file ? "the command that opens it in the program" : "open another frame, demo or session"}`} label=${html`
      <span class="two"><b>${frame.title}</b>
      <span class="dim">${detail}</span></span><${Icon} name="down" />`}>
      ${(close) => state.file ? html`<div class="open-list"><p>${state.file.command}</p></div>` : html`<div class="open-list"><input placeholder="filter, or the path of a file" value=${text}
        onInput=${(e) => setText(e.currentTarget.value)} />
        <div class="scroll">${file && html`<${MenuItem} onClick=${() => { close(); send({ verb: "open", [file === "toml" ? "session" : "recording"]: text.trim() }); }}>
          Open the ${file === "toml" ? "session" : "recording"} ${text.trim()}<//>`}
        ${lists.map(([title, list, verb, on]) => html`<h3>${title}</h3>
          ${list.map((one) => [one, words(one, list)]).filter(fits).map(([one, w]) => html`
            <${MenuItem} on=${on(one)} detail=${one.detail}
              onClick=${() => { close(); send({ verb: "open", ...verb(one) }); }}>${w}<//>`)}`)}
        </div></div>`}
    <//>
  </div>`;
}

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
      ${several && html`<b class="name">${label}</b>`}
      ${outcome.err != null ? html`<span class="figure"
        title=${LIMIT}><b>${number(outcome.err, 1)} mm</b> of ${number(outcome.limit, 1)} allowed</span>` : ""}
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

// Below the verdict, what happened at the cursor.
function Here({ moment }) {
  const { head, words, text } = goingWords(moment);
  return html`<span title=${text}><b>${head}</b> ${words}</span>`;
}

// What happened at the cursor.
function goingWords(moment) {
  const { k, row, isCurrent, stage, stages, arms, object, best } = moment;
  const text = stage ? row.stages.find((s) => s.name === stage)?.text : row?.text;
  const place = stage && `stage ${stages.indexOf(stage) + 1} of ${stages.length}: ${stage}`;
  const edited = state.view.edited;
  let words = edited ? `the pose of hypothesis ${edited.arm + 1} of ${object.label} is being edited`
    : `works on another object; ${object.label} is shown as it is by now`;
  if (k === 0) {
    const n = state.frame.objects.length;
    words = `${n > 1 ? `${n} objects` : object.label}, ${arms.length} hypothes${arms.length === 1 ? "is" : "es"}`;
    if (best?.score != null) words += `, best initial score ${number(best.score)}`;
  } else if (isCurrent && !edited) words = stage ? `hypothesis ${row.arm + 1} of ${arms.length} · ${place}` : row.brief;
  return { head: k ? `Iteration ${k}` : moment.over ? "Before iteration 1" : "Ready", words, text };
}

// While nothing is decided.
function Going({ moment }) {
  const edits = useStore((s) => s.branches.find((b) => b.index === moment.branch)?.edits) ?? [];
  const first = moment.k ? [] : edits.filter((e) => e.k === 0).map((e) => editWords(e, state.frame.objects));
  const { head, words, text } = goingWords(moment);
  return html`<div class="words going" title=${text}>
    <div class="first"><b>${head}</b> <span>${words}</span></div>
    <div class="second">${(moment.over && moment.run.missing) || text || first.join("; ") || moment.object.left_out || ""}</div>
  </div>`;
}

const numbers = (o) => [
  o.err != null && `${number(o.err, 1)} mm of ${number(o.limit, 1)} allowed`,
  o.deg != null && `${number(o.deg, 1)}°${o.way && o.deg >= 1 ? ` (${o.way})` : ""}, ${number(o.mm, 1)} mm off`,
  o.score != null && `score ${number(o.score, 3)}`,
  o.score != null && `hypothesis ${o.arm + 1}, ${o.k ? `iteration ${o.k}` : "an initial pose"}`,
].filter(Boolean).join(" · ");
const capital = (text) => (text ? text[0].toUpperCase() + text.slice(1) : "");

function Why({ verdict, first, n }) {
  const frame = useStore((s) => s.frame);
  const objects = [...verdict.objects].sort((a, b) => (b.obj === first) - (a.obj === first));
  const shown = new Set(verdict.objects.flatMap((o) => (o.findings ?? []).map((f) => f.text)));
  const doubts = [...new Set([...(verdict.doubts ?? []), ...(verdict.notes ?? [])])].filter((text) => !shown.has(text));
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
              onClick=${() => { close(); setView({ obj: o.obj, arm: null }); seek(f.k); }}>Iteration ${f.k}<//>`}
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
