// The timeline: the run's only controls, its marks, lanes of objects or hypotheses, and the curve of scores.
import { html } from "htm/preact";
import { useEffect, useLayoutEffect, useRef, useState, useMemo } from "preact/hooks";
import { state, useStore, setView, update, send } from "./store.js";
import { armColor, momentOf, ranksOf, runOf, sourceOf } from "./moment.js";
import { back, isBusy, pause, run, seek, step, stepStage, toNextEvent } from "./cursor.js";
import { palette, rampColor, stageColor } from "./palette.js";
import { Button, counted, IconButton, Menu, number, Select, Swatch, Toggle } from "./ui.js";
import { titled } from "./keys.js";
import { remember } from "./layout.js";
import { FrameStrip } from "./frame_strip.js";
import { draw, modelOf, placeOf, scaleOf, SHAPES, TONES } from "./timeline_drawing.js";

export function Timeline() {
  return html`<section class="timeline"><${FrameStrip} /><${Controls} /><${Strip} /></section>`;
}

/** @import { BreakpointSettings, FrameMessage, IterationRow, Mark, ThresholdSettings } from "./messages.d.ts" */
/** @import { State } from "./store.js" */

// The line of controls.

function Controls() {
  const [moment, busy, running, speed, stage] = useStore((s) => [
    momentOf(s), isBusy(), s.running, s.speed, s.view.stage, s.frame?.breakpoints,
  ]);
  if (!moment) return html`<div class="controls" />`;
  const { k, total, over, row, isAnswer, isCurrent, stages } = moment;
  const done = moment.run.rows.length;
  const stops = stopsOf(state.frame);
  return html`<div class="controls">
    <div class="group">
      <${IconButton} icon="back" title=${titled("back")} disabled=${k === 0} onClick=${back} />
      <${Button} icon="stage" title=${titled("stage")} onClick=${stepStage}>Stage<//>
      <${Button} icon="step" title=${titled("step")} onClick=${step}>Step<//>
    </div>
    <div class="group">
      ${busy
        ? html`<${Button} icon="pause" kind="primary run" title=${titled("run", "Pause after the iteration at hand")}
          onClick=${pause}>Pause<//>`
        : html`<${Button} icon="run" kind="primary run" onClick=${() => run()}
            title=${titled("run", over ? "Replay the finished run" : "Compute to the end")}>
            ${over ? "Replay" : "Run"}<//>`}
      <${IconButton} icon="prevEvent" title=${titled("event-back")} onClick=${() => toNextEvent(-1)} />
      <${IconButton} icon="event" title=${titled("event")} onClick=${() => toNextEvent(1)} />
      <${Breakpoints} stops=${stops} />
    </div>
    <span class="place" title=${isAnswer
      ? "the run is over: its answer is shown" : "the iteration that is shown, of all of the run"}>
      <b>${k}</b><span class="dim"> of ${total}${done < total ? ` · ${done} made` : ""}</span>
    </span>
    <span class="where">${isAnswer
      ? html`<button type="button" class="link"
        title="The answer is shown. The last iteration may have tried another pose: show it" onClick=${(e) => {
          e.currentTarget.blur();
          setView({ stage: moment.run.rows.at(-1).stages.at(-1).name, obj: moment.run.rows.at(-1).obj });
        }}>show last</button>`
      : k > 0 && isCurrent
        ? html`<${StageDots} stages=${stages} stage=${stage} accepted=${row.accepted} />`
        : k === 0 ? "initial poses" : `latest of ${moment.object.label}: ${row ? row.k : "none"}`}</span>
    <span class="spring" />
    ${running.branch != null && running.remaining_s != null && html`<span
      class="dim">${Math.ceil(running.remaining_s)} s left</span>`}
    <${Marks} />
    ${over && html`<span class="tone" title="green frame: the iteration that made the answer"><i
      class="ring" /></span>`}
    <${Legend} />
    <${Select} value=${String(speed)} title="iterations a second of a replay"
      onChange=${(v) => remember({ speed: Number(v) })}
      options=${["2", "4", "8", "16", "30", "60"].map((v) => [v, `${v}/s`])} />
  </div>`;
}

const StageDots = ({ stages, stage, accepted }) => {
  const at = stage == null ? stages.length - 1 : stages.indexOf(stage);
  return html`<span class="stages">${stages.map((name, i) => html`
    <button type="button" class=${`dot ${i <= at ? "on" : ""}`}
      title=${`${name}${name === accepted ? ", accepted" : ""} (S: next stage)`}
      onClick=${(e) => { e.currentTarget.blur(); setView({ stage: i === stages.length - 1 && stage != null && at === i
        ? null : name, moment: null }); }}>
      <${Swatch} color=${stageColor(name)}
        hollow=${i > at} />${i === at ? name : ""}${name === accepted && i <= at ? " ✓" : ""}
    </button>`)}</span>`;
};

// When a run stops and waits: [field, words, number offered].
/** @type {([keyof ThresholdSettings & keyof BreakpointSettings, string, number, string] | [keyof BreakpointSettings, string])[]} */
const STOPS = [
  ["score_falls_by", "the score falls by more than", 0.02, ""],
  ["jump_mm", "the pose moves by more than", 10, "mm"],
  ["jump_deg", "the pose turns by more than", 10, "°"],
  ["error_grows_by_mm", "the error grows by more than", 2, "mm"],
  ["simulated_rejected", "the refined pose is accepted"],
  ["refined_rejected", "the simulated pose is accepted"],
  ["arm_switched", "another hypothesis is chosen"],
  ["unstable", "the object would tip"],
  ["physics_worse", "the simulated pose scores far less"],
  ["empty_render", "a pose renders to nothing"],
];
const knowsErrors = (/** @type {State} */ s) => s.frame?.objects.some((o) => o.has_gt) ?? false;
// What colours say: of errors that nothing is known of, none.
const colorByOf = (/** @type {State} */ s) => (s.colorBy === "error" && !knowsErrors(s) ? "score" : s.colorBy);
/** @param {FrameMessage | null} frame */
const stopsOf = (frame) => STOPS.filter(([name]) => !/** @type {unknown[]} */ ([null, undefined, false]).includes(frame?.breakpoints?.[name]));

function Breakpoints({ stops }) {
  if (state.file) return null; // nothing runs
  const values = state.frame.breakpoints;
  const change = (name, value) => {
    send({ verb: "break", changes: { [name]: value } });
    update({ frame: Object.assign(state.frame, { breakpoints: { ...state.frame.breakpoints, [name]: value } }) });
  };
  const words = stops.map(([, w]) => w).join("; ");
  return html`<${Menu} kind=${stops.length ? "armed" : ""} icon="stop" label=${stops.length || ""}
    title=${stops.length ? `A run stops when ${words}` : "Breakpoints: none set, a run goes to its end"}>
    <div class="form"><h3>A run stops when</h3>${STOPS.filter(([name]) => name !== "error_grows_by_mm" || knowsErrors(state)).map(([name, w, offered, unit]) => {
      const value = values[name];
      const on = value != null && value !== false;
      const threshold = on ? value : values.waiting?.[name] ?? offered; // of one that is off, what it had
      return html`<div class="row"><${Toggle} value=${on}
        onChange=${(v) => change(name, offered == null ? v : v ? threshold : null)}>${w}<//>
        ${offered != null && html`<input type="number" step="any" disabled=${!on} value=${threshold}
          onChange=${(e) => e.currentTarget.value && change(name, Number(e.currentTarget.value))} /><span
            class="dim">${unit}</span>`}</div>`;
    })}</div>
  <//>`;
}

// The tones of the run's marks: how many, and whether they are drawn.
function Marks() {
  const [marks, hidden] = useStore((s) => [runOf(s).marks, hiddenOf(s)]);
  /** @type {Record<string, number>} */
  const counts = {};
  for (const m of marks) counts[m.tone] = (counts[m.tone] ?? 0) + 1;
  const toggle = (tone) => {
    const next = new Set(hidden);
    if (!next.delete(tone)) next.add(tone);
    update({ hiddenTones: next });
  };
  const present = Object.entries(TONES).filter(([tone]) => counts[tone]);
  return html`<span class="tones">${present.map(([tone, { words, shape }]) => html`
    <button type="button" class=${`tone ${hidden.has(tone) ? "off" : ""}`}
      title=${`${counts[tone]} × ${words}; click: hide or show`}
      onClick=${(e) => { e.currentTarget.blur(); toggle(tone); }}>
      <svg viewBox="-6 -6 12 12"><path d=${SHAPES[shape]} fill=${palette.marks[tone]} /></svg>${counts[tone]}
    </button>`)}</span>`;
}
// Where another hypothesis is chosen nearly every time, that is no event.
/** @type {Set<string>} */
const NONE = new Set();
const SWITCHED = new Set(["switched"]);
/** @param {State} s */
function hiddenOf(s) {
  if (s.hiddenTones) return s.hiddenTones;
  const { marks, rows } = runOf(s);
  return marks.filter((m) => m.tone === "switched").length > rows.length / 2 ? SWITCHED : NONE;
}


// The hypotheses of the object at the cursor, best first; a click marks one on the timeline and shows its history.
function Legend() {
  const [text, setText] = useState("");
  const [moment, arm, by] = useStore((s) => [momentOf(s), s.view.arm, colorByOf(s)]);
  if (!moment) return null;
  const hasErrors = moment.arms.some((a) => a.err != null);
  const order = ranksOf(moment, by);
  const scale = scaleOf(moment.run, by);
  const list = moment.arms.map((a, j) => ({ ...a, j, source: sourceOf(moment, j) }))
    .filter((a) => `hypothesis ${a.j + 1} ${a.source}`.includes(text.toLowerCase()))
    .sort((a, b) => order[a.j] - order[b.j]);
  return html`<${Menu} icon="list" align="right" title="Hypotheses: what colours say, scores, filter"
    label=${html`<span class="word">Hypotheses</span>`}>
    <div class="arms"><h3>${counted(moment.arms.length, "hypothesis", "hypotheses")} of ${moment.object.label}</h3>
      <div class="row"><${Select} value=${by} label="colour" title="what the colours on the timeline say"
        onChange=${(v) => remember({ colorBy: v })}
        options=${[["rank", "rank of the hypothesis"], ["score", "score of the pose"],
          ["error", "error of the pose"]].filter(([id]) => id !== "error" || knowsErrors(state))} />
        <span class="ramp">${[0, 0.25, 0.5, 0.75, 1].map((t) => html`<i
          style=${{ background: rampColor(t) }} />`)}</span><span class="dim">good</span></div>
      <input placeholder="filter" value=${text} onInput=${(e) => setText(e.currentTarget.value)} />
      <div class="scroll"><table class="table"><thead><tr><th
        class="left">hypothesis</th><th>score</th>${hasErrors && html`<th>mm</th>`}</tr></thead>
      <tbody>${list.map((a) => html`<tr key=${a.j} class=${`clickable ${arm === a.j ? "current" : ""}`}
        onClick=${() => setView({ arm: arm === a.j ? null : a.j })}>
        <td class="left"><${Swatch}
          color=${by === "rank" ? armColor(moment, a.j) : rampColor(scale(a))} /> ${a.j + 1} <span
            class="dim">${a.source}</span></td>
        <td>${number(a.score, 3)}</td>${hasErrors && html`<td>${number(a.err, 1)}</td>`}</tr>`)}
      </tbody></table></div>
    </div>
  <//>`;
}
// The strip: what is drawn is worked out once for a run and drawn once for a size (timeline_drawing.js); the cursor is an
// element that moves.

function Strip() {
  const host = useRef(null);
  const canvas = useRef(null);
  const [size, setSize] = useState(null);
  const [hover, setHover] = useState(null);
  const [frame, runData, obj, by, hidden, arm, theme] = useStore((s) => [
    s.frame, runOf(s), s.view.obj, colorByOf(s), hiddenOf(s), s.view.arm, s.theme,
  ]);
  const model = useMemo(() => frame && modelOf(frame, runData, obj, by, hidden, arm),
    [frame, runData, obj, by, hidden, arm]);
  useLayoutEffect(() => {
    const measure = () => {
      const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
      setSize([host.current.clientWidth, host.current.clientHeight, rem, devicePixelRatio]);
    };
    const observer = new ResizeObserver(measure);
    observer.observe(host.current);
    return () => observer.disconnect();
  }, []);
  const place = useMemo(() => size && model && placeOf(model, size), [size, model]);
  useEffect(() => {
    if (!place) return undefined;
    const request = requestAnimationFrame(() => draw(canvas.current, model, place));
    return () => cancelAnimationFrame(request);
  }, [place, theme]);

  const kAt = (e) => {
    const x = e.clientX - host.current.getBoundingClientRect().left;
    return Math.max(0, Math.min(model.total, Math.ceil((x - place.left) / place.cell)));
  };
  const down = (e) => {
    if (!place || e.button !== 0) return;
    const y = e.clientY - host.current.getBoundingClientRect().top;
    const x = e.clientX - host.current.getBoundingClientRect().left;
    if (x < place.left - 4) {
      const lane = model.lanes[Math.floor((y - place.lanesTop) / place.lane)];
      if (lane && !place.strip && y >= place.lanesTop) {
        if (lane.id != null) setView({ obj: state.view.obj === lane.id ? null : lane.id, arm: null });
        else setView({ arm: state.view.arm === lane.arm ? null : lane.arm });
      }
      return;
    }
    host.current.setPointerCapture(e.pointerId);
    setHover(null);
    seek(Math.min(kAt(e), model.done || 0));
  };
  const move = (e) => {
    if (!place) return;
    const box = host.current.getBoundingClientRect();
    if (host.current.hasPointerCapture(e.pointerId)) seek(Math.min(kAt(e), model.done));
    else if (e.clientX - box.left < place.left) setHover(null);
    else setHover({ k: kAt(e), x: e.clientX - box.left, y: e.clientY - box.top });
  };
  const name = (/** @type {number} */ id) => frame.objects.find((o) => o.id === id)?.label ?? "";
  return html`<div class="strip" ref=${host} onPointerDown=${down} onPointerMove=${move}
    onPointerLeave=${() => setHover(null)}>
    <canvas ref=${canvas} />
    ${place && html`<${Cursor} place=${place} />`}
    ${place && hover && hover.k > 0 && html`<${Hint} hover=${hover} row=${runData.rows[hover.k - 1]} k=${hover.k}
      marks=${model.marks.filter((m) => m.k === hover.k)} name=${model.several ? name : null} width=${size[0]} />`}
  </div>`;
}

function Cursor({ place }) {
  const k = useStore((s) => Math.min(s.view.k, runOf(s).rows.length));
  const x = place.left + (k ? (k - 0.5) * place.cell : 0);
  return html`<div class="cursor" style=${{ transform: `translateX(${x.toFixed(1)}px)` }}><i>${k}</i></div>`;
}

/**
 * @param {{ hover: { x: number }, row: IterationRow | undefined, k: number, marks: Mark[],
 *   name: ((id: number) => string) | null, width: number }} props
 */
function Hint({ hover, row, k, marks, name, width }) {
  const side = hover.x > width / 2 ? { right: `${width - hover.x + 12}px` } : { left: `${hover.x + 12}px` };
  if (!row) return html`<div class="hint" style=${side}>iteration ${k}: not computed yet</div>`;
  const stage = row.stages.find((s) => s.name === row.accepted);
  const error = stage?.err != null ? ` · ${number(stage.err, 1)} mm` : "";
  return html`<div class="hint" style=${side}>
    <b>iteration ${k}</b>${name && html` · ${name(row.obj)}`} · hypothesis ${row.arm + 1}
    <div>${row.accepted} accepted · score ${number(stage?.score, 3)}${error}</div>
    ${marks.map((m) => html`<div class="mark"><svg viewBox="-6 -6 12 12"><path
      d=${SHAPES[TONES[m.tone]?.shape ?? "circle"]}
      fill=${palette.marks[m.tone] ?? "currentColor"} /></svg>${m.text}</div>`)}
  </div>`;
}
