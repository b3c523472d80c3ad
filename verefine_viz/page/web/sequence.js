// The objects of a sequence over its frames: lanes, marks and curves to zoom into, and what a span of frames comes to.
import { html } from "htm/preact";
import { useEffect, useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import { addressOf, arraysOf, send, state, update, useStore } from "./store.js";
import { runOf } from "./moment.js";
import { openAnswer } from "./answers.js";
import { addKeys } from "./keys.js";
import { presets, setPreset } from "./layout.js";
import { limits, palette } from "./palette.js";
import { Button, counted, number, Select, Swatch, Table } from "./ui.js";
import { useLatest } from "./tabs/latest.js";
import { anchorsOf, gradient } from "./colours.js";
import { curvesOf, draw, placeOf, SCALE, xOf } from "./sequence_drawing.js";
import { firstOf, lanesOf, MARKS, moved, NO_POSE, NOT_SOLVED, statistics, within, zoomed } from "./sequence_data.js";

/** @import { AnswersMessage, SequenceAnswer } from "./messages.d.ts" */
/** @import { Lanes, Measure } from "./sequence_data.js" */
/** @import { Place } from "./sequence_drawing.js" */
/** @import { State, Arrays } from "./store.js" */
/** @typedef {{ lane: number, frame: number }} Cell */

const MOST_MARKS = 300; // in the list
const CLICK = 4; // pixels up to which a press is no drag

/** @param {Partial<import("./store.js").SequenceView>} patch */
const look = (patch) => update({ sequence: { ...state.sequence, ...patch } });

/** @type {WeakMap<AnswersMessage, number>} */
const versions = new WeakMap(); // answers that came → their number
let nVersions = 1;
/** @param {State} s */
function doneAt(s) {
  if (!s.answers) return Number(s.runs.size > 0 && runOf(s).over);
  if (!versions.has(s.answers)) versions.set(s.answers, ++nVersions);
  return versions.get(s.answers);
}

/** @type {WeakMap<AnswersMessage, boolean>} */
const several = new WeakMap();
// Whether there are frames to be shown side by side.
/** @param {State} s */
export function hasSequence(s) {
  if (!s.answers) return !s.file && (s.frame?.frames.length ?? 0) > 1;
  if (!several.has(s.answers)) several.set(s.answers, new Set(s.answers.rows.map((row) => row.frame)).size > 1);
  return several.get(s.answers);
}

// The switch between cards and frames in a row.
export function Switch() {
  const [on, has] = useStore((s) => [s.sequence.on, hasSequence(s)]);
  return has && html`<div class="group switch">
    <${Button} on=${!on} title="a card for each" onClick=${() => look({ on: false })}>Cards<//>
    <${Button} on=${on} title="objects over the frames" onClick=${() => look({ on: true })}>Timeline<//></div>`;
}

/** @type {WeakMap<Arrays, Lanes>} */
const unpacked = new WeakMap(); // arrays → lanes of them
// Beside a frame its own run and scene, in the gallery those that are chosen.
/** @type {(small: boolean) => { lanes: Lanes | null, answer: SequenceAnswer | { gone: string } | undefined }} */
function useLanes(small) {
  const [run, scene, done] = useStore((s) => [
    small ? "" : s.sequence.run || s.frame?.run || s.answers?.runs[0] || "", small ? null : s.sequence.scene, doneAt(s)]);
  const of = useMemo(() => /** @type {const} */ ({ what: "sequence", run, scene, done }), [run, scene, done]);
  const answer = useLatest(of, "sequence", `${run} ${scene}`);
  const arrays = useStore(() => arraysOf(answer));
  const last = useRef(/** @type {Lanes | null} */ (null));
  if (answer && !("gone" in answer) && arrays) {
    if (!unpacked.has(arrays)) unpacked.set(arrays, lanesOf(answer, arrays));
    last.current = unpacked.get(arrays);
  }
  return { lanes: answer && "gone" in answer ? null : last.current, answer };
}

/** @param {{ small?: boolean }} props */
export function Sequence({ small = false }) {
  const { lanes, answer } = useLanes(small);
  const view = useStore((s) => s.sequence);
  if (answer && "gone" in answer) return html`<p class="empty">${answer.gone}</p>`;
  if (!lanes) return html`<p class="empty">Reading the frames.</p>`;
  if (!lanes.n || !lanes.measures.length) return html`<p class="empty">Two solved frames make a timeline.</p>`;
  const measure = lanes.measures.find(({ id }) => id === view.by) ?? firstOf(lanes);
  const lane = Math.min(view.lane, lanes.answer.lanes.length - 1);
  return html`<div class=${`sequence ${small ? "small" : ""}`}>
    <div class="sequence-main scroll"><${Controls} lanes=${lanes} measure=${measure} small=${small} />
      <${Strip} lanes=${lanes} measure=${measure} lane=${lane} />
      <${Statistics} lanes=${lanes} lane=${lane} small=${small} /></div>
    <${MarkList} lanes=${lanes} /></div>`;
}

/** @param {{ lanes: Lanes, measure: Measure, small: boolean }} props */
function Controls({ lanes, measure, small }) {
  const [view, answers] = useStore((s) => [s.sequence, s.answers]);
  const { answer } = lanes;
  const kinds = [["--faint", NO_POSE, "no pose"], ["--over", NOT_SOLVED, "not solved"]].filter(([, state]) => lanes.states.some((s) => s.includes(Number(state))));
  return html`<div class="sequence-bar">
    ${!small && answers?.runs.length > 1 && html`<${Select} label="Run" value=${answer.run} options=${[...answers.runs]}
      onChange=${(run) => look({ run, scene: null, lane: 0, brush: null, from: 0, to: Infinity })} />`}
    ${!small && answer.scenes.length > 1 && html`<${Select} label="Scene" value=${String(answer.scene)} options=${answer.scenes.map(String)}
      onChange=${(scene) => look({ scene: Number(scene), lane: 0, brush: null, from: 0, to: Infinity })} />`}
    <${Select} label="Colour" value=${measure.id} options=${lanes.measures.map((m) => [m.id, m.title])} onChange=${(by) => look({ by })} />
    <span class="scale"><span>0</span><i style=${{ background: gradient(anchorsOf(SCALE)) }} /><span>${+measure.top.toPrecision(2)} ${measure.unit}</span></span>
    ${kinds.map(([color, , words]) => html`<span class="dim"><${Swatch} color=${`var(${color})`} />${words}</span>`)}
    <span class="spring" />
    <span class="dim">${counted(lanes.n, "frame")}</span>
    <${Button} disabled=${view.to === Infinity} title="All frames (double click)" onClick=${() => look({ from: 0, to: Infinity })}>All<//>
  </div>`;
}

/** @type {(lanes: Lanes, cell: Cell) => unknown} */
function open(lanes, { lane, frame }) {
  look({ lane });
  const key = lanes.keys[lane][frame];
  if (key >= 0 && state.answers) return openAnswer(state.answers.rows[key]);
  const isOpen = !state.answers || state.frame?.run === lanes.answer.run;
  if (state.file || !isOpen || lanes.states[lane][frame] === 0) return undefined;
  if (state.view.preset === "gallery") setPreset(presets(state).find(({ id }) => ["label", "inspect"].includes(id)).id);
  return send({ verb: "open", frame: lanes.answer.frames[frame], object: lanes.answer.lanes[lane].object });
}

/** @param {{ lanes: Lanes, measure: Measure, lane: number }} props */
function Strip({ lanes, measure, lane }) {
  const [view, theme, here] = useStore((s) => [s.sequence, s.theme, s.frame?.frame]);
  const host = useRef(/** @type {HTMLDivElement | null} */ (null));
  const canvas = useRef(/** @type {HTMLCanvasElement | null} */ (null));
  const [size, setSize] = useState({ width: 0, rem: 16 });
  const [near, setNear] = useState(/** @type {(Cell & { x: number, y: number }) | null} */ (null));
  const curves = curvesOf(lanes);
  const place = placeOf(lanes, curves, size.width, size.rem);
  const live = useRef({ lanes, place });
  live.current = { lanes, place };
  useLayoutEffect(() => {
    const measured = () => setSize({ width: host.current.clientWidth, rem: parseFloat(getComputedStyle(document.documentElement).fontSize) });
    const observer = new ResizeObserver(measured);
    observer.observe(host.current);
    measured();
    return () => observer.disconnect();
  }, []);
  useLayoutEffect(() => {
    if (size.width) draw(canvas.current, lanes, { measure, curves, from: view.from, to: view.to, lane, place });
  }, [lanes, measure, view.from, view.to, lane, theme, size.width, size.rem]);
  useEffect(() => wheeled(host.current, live), []);
  useEffect(() => keyed(host.current, live), []);
  const span = within(view, lanes.n);
  const box = ([first, last]) => {
    const x = (frame) => Math.max(place.left, Math.min(place.left + place.width, xOf(frame, span, place)));
    return { left: `${x(first)}px`, width: `${Math.max(1, x(last + 1) - x(first))}px`, top: `${place.top}px`, height: `${place.height - place.top}px` };
  };
  const at = lanes.answer.frames.indexOf(here);
  return html`<div class="sequence-lanes" ref=${host} tabindex="0" style=${{ height: `${place.height}px` }} aria-label="objects over frames"
      onPointerDown=${(e) => pressed(e, live, setNear)} onPointerMove=${(e) => e.buttons || setNear(cellAt(e, live))}
      onPointerLeave=${() => setNear(null)} onDblClick=${() => look({ from: 0, to: Infinity, brush: null })}>
    <canvas ref=${canvas} style=${{ height: `${place.height}px` }} />
    ${at >= span.from && at < span.to && html`<i class="here" style=${box([at, at])} />`}
    ${view.brush && html`<i class="brush" style=${box(view.brush)} />`}
    ${near && html`<${Tip} lanes=${lanes} near=${near} place=${place} />`}</div>`;
}

/** @type {(e: PointerEvent | WheelEvent, live: { current: { lanes: Lanes, place: Place } }) => (Cell & { x: number, y: number }) | null} */
function cellAt(e, { current: { lanes, place } }) {
  const box = /** @type {HTMLElement} */ (e.currentTarget).getBoundingClientRect();
  const [x, y] = [e.clientX - box.left, e.clientY - box.top];
  const span = within(state.sequence, lanes.n);
  const frame = Math.floor(span.from + ((x - place.left) / place.width) * (span.to - span.from));
  const lane = y >= place.bottom ? Math.min(state.sequence.lane, lanes.answer.lanes.length - 1) : Math.floor((y - place.top) / place.lane);
  return x < place.left || frame >= lanes.n || lane < 0 ? null : { lane, frame: Math.max(0, frame), x, y };
}

// A drag over the lanes marks a span; over the axis, or with Shift, it moves what is in sight; a click opens or chooses.
function pressed(e, live, setNear) {
  if (e.button !== 0) return;
  const host = e.currentTarget;
  const cell = cellAt(e, live);
  const { left, top } = host.getBoundingClientRect();
  const { lanes, place } = live.current;
  const from = { x: e.clientX, span: within(state.sequence, lanes.n) };
  const pans = e.shiftKey || e.clientY - top < place.top;
  const per = (from.span.to - from.span.from) / place.width;
  let isDrag = false;
  host.setPointerCapture(e.pointerId);
  const move = (m) => {
    isDrag ||= Math.abs(m.clientX - from.x) > CLICK;
    if (!isDrag) return;
    setNear(null);
    if (pans) return look(state.sequence.to === Infinity ? {} : moved(from.span, lanes.n, (from.x - m.clientX) * per));
    const frame = (x) => Math.max(0, Math.min(lanes.n - 1, Math.floor(from.span.from + (x - left - place.left) * per)));
    const ends = [frame(from.x), frame(m.clientX)];
    return look({ brush: [Math.min(...ends), Math.max(...ends)] });
  };
  const up = () => {
    for (const [name, listener] of Object.entries({ pointermove: move, pointerup: up, pointercancel: up })) host.removeEventListener(name, listener);
    if (isDrag) return;
    const name = Math.floor((e.clientY - top - place.top) / place.lane);
    if (cell) open(live.current.lanes, cell);
    else if (name >= 0 && name < lanes.answer.lanes.length) look({ lane: name });
  };
  for (const [name, listener] of Object.entries({ pointermove: move, pointerup: up, pointercancel: up })) host.addEventListener(name, listener);
}

const ZOOM = 1.25;
const PAN = 0.12; // of what is in sight
/** @type {(live: { current: { lanes: Lanes } }, by: number) => void} */
const pan = ({ current: { lanes } }, by) => look(moved(state.sequence, lanes.n, by * (within(state.sequence, lanes.n).to - state.sequence.from)));

// Ctrl zooms at the pointer, Shift or a wheel to the side moves; else what is around scrolls.
function wheeled(host, live) {
  const wheel = (/** @type {WheelEvent} */ e) => {
    const { lanes, place } = live.current;
    const aside = e.shiftKey && !e.deltaX ? e.deltaY : e.deltaX;
    if (e.ctrlKey || e.metaKey) look(zoomed(state.sequence, lanes.n, Math.exp(-e.deltaY / 400), cellAt(e, live)?.frame));
    else if (Math.abs(aside) > Math.abs(e.shiftKey ? 0 : e.deltaY)) pan(live, aside / place.width);
    else return;
    e.preventDefault();
  };
  host.addEventListener("wheel", wheel, { passive: false });
  return () => host.removeEventListener("wheel", wheel);
}

// Keys of the lanes, while the pointer is over them or they have the focus.
function keyed(host, live) {
  const when = () => host.matches(":hover") || host.matches(":focus");
  const action = (key, title, action) => ({ id: `sequence-${key}`, keys: [key], title, group: "Timeline of a sequence", action, when });
  const zoom = (by) => look(zoomed(state.sequence, live.current.lanes.n, by, live.current.at?.frame));
  const follow = (e) => { live.current.at = cellAt(e, live); };
  host.addEventListener("pointermove", follow);
  const end = addKeys([
    action("w", "Zoom in", () => zoom(ZOOM)),
    action("s", "Zoom out", () => zoom(1 / ZOOM)),
    action("a", "To earlier frames", () => pan(live, -PAN)),
    action("d", "To later frames", () => pan(live, PAN)),
    { ...action("Escape", "Clear the span", () => look({ brush: null })), when: () => when() && state.sequence.brush != null && !state.overlay },
  ]);
  return () => {
    host.removeEventListener("pointermove", follow);
    end();
  };
}

// What is under the pointer, with the small picture of its frame.
/** @param {{ lanes: Lanes, near: Cell & { x: number, y: number }, place: Place }} props */
function Tip({ lanes, near: { lane, frame, x, y }, place }) {
  const { answer, states, keys, measures, values } = lanes;
  if (lane >= answer.lanes.length || !states[lane][frame]) return null;
  const name = answer.frames[frame];
  const row = state.answers?.rows[keys[lane][frame]];
  const own = state.frame?.frames.indexOf(name) ?? -1;
  const picture = row?.thumb ? `/thumb/${row.key}?${encodeURIComponent(`${row.run} ${row.frame} ${row.obj} ${row.score ?? ""}`)}`
    : own >= 0 && !state.answers ? `/frame/${own}?${encodeURIComponent(`${state.frame.dataset} ${name}`)}` : null;
  const marks = answer.marks.filter(([l, f]) => l === lane && f === frame).map(([, , kind]) => kind);
  const side = x > place.left + place.width / 2 ? { right: `calc(100% - ${x - 12}px)` } : { left: `${x + 12}px` };
  return html`<div class="sequence-tip" style=${{ ...side, top: `${y + 12}px` }}>
    ${picture && !state.file && html`<img src=${addressOf(picture)} alt="" />`}
    <b>${answer.lanes[lane].name}</b> ${name}
    ${marks.map((kind) => html`<div><${Swatch} color=${palette.motions[kind]} />${kind}</div>`)}
    ${states[lane][frame] === NO_POSE ? html`<div>no pose</div>` : states[lane][frame] === NOT_SOLVED ? html`<div>not solved yet</div>`
      : measures.filter(({ id }) => values[id][lane][frame] === values[id][lane][frame])
        .map((m) => html`<div><span class="dim">${m.title}</span> ${number(values[m.id][lane][frame] * m.factor, m.digits)} ${m.unit}</div>`)}</div>`;
}

// What the span, or all frames, come to.
/** @param {{ lanes: Lanes, lane: number, small: boolean }} props */
function Statistics({ lanes, lane, small }) {
  const brush = useStore((s) => s.sequence.brush);
  const [first, last] = brush ?? [0, lanes.n - 1];
  const rows = useMemo(() => statistics(lanes, [first, last], limits.correct), [lanes, first, last]);
  const { frames, lanes: objects } = lanes.answer;
  const zoom = () => look(zoomed({ from: first, to: last + 1 }, lanes.n, 1));
  const columns = [
    { title: "object", left: true, of: (r) => r.lane.name },
    { title: "frames", of: (r) => `${r.poses}${r.poses < r.frames ? ` of ${r.frames}` : ""}` },
    { title: "median mm", hint: "ADD(-S) against ground truth", of: (r) => number(r.median, 1) },
    { title: "right", hint: `below ${100 * limits.correct} % of the diameter`, of: (r) => (r.right == null ? "–" : `${number(100 * r.right, 0)} %`) },
    { title: "mean score", of: (r) => number(r.score) },
    ...MARKS.map((kind) => ({ title: kind, hint: lanes.answer.legend[kind], of: (r) => r.marks[kind] || "–" })),
  ].filter((c, i) => i < 2 || rows.some((r) => c.of(r) !== "–"));
  return html`<div class="sequence-span"><h3>${brush ? `${frames[first]} to ${frames[last]}` : "All frames"}
    ${brush && html` <${Button} title="Show these frames alone" onClick=${zoom}>Zoom in<//><${Button} title="All frames (Esc)" onClick=${() => look({ brush: null })}>Clear<//>`}</h3>
    <${Table} columns=${columns} rows=${rows} keyOf=${(_, i) => i} onRow=${(r) => look({ lane: rows.indexOf(r) })} current=${(r) => r === rows[lane]} />
    ${objects[lane].words && html`<p class="dim">${objects[lane].name}: ${objects[lane].words}${small ? "" : ` Relative to the ${lanes.answer.reference}.`}</p>`}</div>`;
}

/** @param {{ lanes: Lanes }} props */
function MarkList({ lanes }) {
  const [brush, here] = useStore((s) => [s.sequence.brush, s.frame?.frame]);
  const { answer } = lanes;
  const list = useMemo(() => [...answer.marks].sort((a, b) => a[1] - b[1] || a[0] - b[0])
    .filter(([, frame]) => !brush || (frame >= brush[0] && frame <= brush[1])), [lanes, brush]);
  const counts = MARKS.map((kind) => [kind, list.filter((mark) => mark[2] === kind).length]);
  if (!Object.keys(answer.legend).length) return null;
  return html`<aside class="sequence-marks"><div class="kinds">${counts.map(([kind, n]) => html`
      <span title=${answer.legend[kind]}><${Swatch} color=${palette.motions[kind]} />${n} ${kind}</span>`)}</div>
    <ul class="scroll">${list.slice(0, MOST_MARKS).map(([lane, frame, kind]) => html`<li key=${`${lane} ${frame} ${kind}`}><button type="button"
      class=${answer.frames[frame] === here ? "current" : ""} title=${answer.legend[kind]} onClick=${() => open(lanes, { lane, frame })}>
      <${Swatch} color=${palette.motions[kind]} /><span>${answer.frames[frame]}</span><span>${kind}</span><span class="dim">${answer.lanes[lane].name}</span></button></li>`)}
      ${list.length > MOST_MARKS && html`<li class="dim">and ${list.length - MOST_MARKS} more</li>`}</ul></aside>`;
}
