// The timeline: the run's only controls, its marks, lanes of objects or hypotheses, and the curve of scores.
import { html, useEffect, useRef, useState, useMemo } from "./vendor/htm-preact.js";
import { state, useStore, setView, update, send } from "./store.js";
import { armColor, back, isBusy, momentOf, pause, ranksOf, rampColor, rowsOf, run, runOf, seek, sourceOf,
  STAGE_COLORS, startsOf, step, stepStage, toNextEvent, TONES } from "./moment.js";
import { Button, IconButton, Menu, number, Select, Swatch, Toggle } from "./ui.js";
import { titled } from "./keys.js";
import { remember } from "./layout.js";

export function Timeline() {
  return html`<section class="timeline"><${Controls} /><${Strip} /></section>`;
}

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
    ${running.stopped && html`<span class="stopped" title=${running.stopped}>${running.stopped}</span>`}
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
      <${Swatch} color=${STAGE_COLORS[name]}
        hollow=${i > at} />${i === at ? name : ""}${name === accepted && i <= at ? " ✓" : ""}
    </button>`)}</span>`;
};

// When a run stops and waits: [field, words, number offered].
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
const knowsErrors = (s) => s.frame?.objects.some((o) => o.has_gt) ?? false;
// What colours say: of errors that nothing is known of, none.
const colorByOf = (s) => (s.colorBy === "error" && !knowsErrors(s) ? "score" : s.colorBy);
const stopsOf = (frame) => STOPS.filter(([name]) => ![null, undefined, false].includes(frame?.breakpoints?.[name]));

function Breakpoints({ stops }) {
  if (state.file) return null; // nothing runs
  const values = state.frame.breakpoints ?? {};
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
  const counts = {};
  for (const m of marks) counts[m.tone] = (counts[m.tone] ?? 0) + 1;
  const toggle = (tone) => {
    const next = new Set(hidden);
    if (!next.delete(tone)) next.add(tone);
    update({ hiddenTones: next });
  };
  const present = Object.entries(TONES).filter(([tone]) => counts[tone]);
  return html`<span class="tones">${present.map(([tone, { words, color, shape }]) => html`
    <button type="button" class=${`tone ${hidden.has(tone) ? "off" : ""}`}
      title=${`${counts[tone]} × ${words}; click: hide or show`}
      onClick=${(e) => { e.currentTarget.blur(); toggle(tone); }}>
      <svg viewBox="-6 -6 12 12"><path d=${SHAPES[shape]} fill=${color} /></svg>${counts[tone]}
    </button>`)}</span>`;
}
// Where another hypothesis is chosen nearly every time, that is no event.
const NONE = new Set();
const SWITCHED = new Set(["switched"]);
state.hiddenTones = null; // until tones are chosen
function hiddenOf(s) {
  if (s.hiddenTones) return s.hiddenTones;
  const { marks, rows } = runOf(s);
  return marks.filter((m) => m.tone === "switched").length > rows.length / 2 ? SWITCHED : NONE;
}

const SHAPES = {
  down: "M-5-4h10L0 5z", up: "M-4 3.5h8L0-4z", square: "M-4-4h8v8h-8z", circle: "M0-4.5a4.5 4.5 0 1 0 .01 0z",
    bar: "M-1.5-5h3v10h-3z",
  cross: "M-5-3 -3-5 0-2 3-5 5-3 2 0 5 3 3 5 0 2 -3 5 -5 3 -2 0z",
};
const PATHS = {};

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
    <div class="arms"><h3>${moment.arms.length} hypotheses of ${moment.object.label}</h3>
      <div class="row"><${Select} value=${by} label="colour" title="what the colours on the timeline say"
        onChange=${(v) => remember({ colorBy: v })}
        options=${[["score", "score of the pose"], ["rank", "rank of the hypothesis"],
          ["error", "error of the pose"]].filter(([id]) => id !== "error" || knowsErrors(state))} />
        <span class="ramp">${[0, 0.25, 0.5, 0.75, 1].map((t) => html`<i
          style=${{ background: rampColor(t) }} />`)}</span><span class="dim">good</span></div>
      <input placeholder="filter" value=${text} onInput=${(e) => setText(e.currentTarget.value)} />
      <div class="scroll"><table class="table"><thead><tr><th
        class="left">hypothesis</th><th>plays</th><th>score</th>${hasErrors && html`<th>mm</th>`}</tr></thead>
      <tbody>${list.map((a) => html`<tr key=${a.j} class=${`clickable ${arm === a.j ? "current" : ""}`}
        onClick=${() => setView({ arm: arm === a.j ? null : a.j })}>
        <td class="left"><${Swatch}
          color=${by === "rank" ? armColor(moment, a.j) : rampColor(scale(a))} /> ${a.j + 1} <span
            class="dim">${a.source}</span></td>
        <td>${number(a.plays, 0)}</td><td>${number(a.score, 3)}</td>${hasErrors && html`<td>${number(a.err, 1)}</td>`}</tr>`)}
      </tbody></table></div>
    </div>
  <//>`;
}
// Numbers to shares of the ramp, good = 1: the run's lowest and highest score or error are its ends.
function scaleOf({ rows }, by) {
  const of = (s) => (by === "error" ? s?.err : s?.score);
  const known = rows.map((row) => of(row.stages.find((s) => s.name === row.accepted))).filter((x) => x != null);
  const low = Math.min(...known);
  const span = Math.max(...known) - low || 1;
  return (pose) => {
    const value = of(pose);
    if (value == null || !known.length) return 0.5;
    return by === "error" ? 1 - (value - low) / span : (value - low) / span;
  };
}

// The strip: what is drawn is worked out once for a run and drawn once for a size; the cursor is an element that moves.

function modelOf(frame, runData, obj, by, hidden, arm) {
  const { rows, total } = runData;
  const objects = frame.objects.filter((o) => startsOf(runData, o).length);
  const several = objects.length > 1;
  const focus = obj ?? (several ? null : objects[0]?.id);
  const last = new Map();
  for (const row of rows) last.set(row.obj, row);
  const ranks = new Map();
  for (const [id, row] of last) {
    const order = row.arms.map((a, j) => j)
      .sort((i, j) => (row.arms[j].score ?? 0) - (row.arms[i].score ?? 0) || i - j);
    const shares = [];
    order.forEach((j, r) => (shares[j] = order.length > 1 ? 1 - r / (order.length - 1) : 1));
    ranks.set(id, shares);
  }
  const accepted = rows.map((row) => row.stages.find((s) => s.name === row.accepted) ?? {});
  const scale = scaleOf(runData, by);
  const share = (row, stage) => (by === "rank" ? ranks.get(row.obj)[row.arm] : scale(stage));
  const cells = rows.map((row, i) => ({
    k: row.k, obj: row.obj, arm: row.arm, share: share(row, accepted[i]), score: accepted[i].score,
    faint: (focus != null && row.obj !== focus) || (arm != null && row.arm !== arm),
  }));
  // Several objects have a lane each; once one is chosen its hypotheses have, below a band in the objects' colours.
  const chosen = objects.find((o) => o.id === focus);
  const lanes = !chosen
    ? objects.map((o) => ({ name: o.label, color: o.color, has: (c) => c.obj === o.id, id: o.id }))
    : startsOf(runData, chosen).map((a, j) => ({ name: `hyp. ${j + 1}`, has: (c) => c.obj === chosen.id && c.arm === j, arm: j }));
  const band = several && chosen ? new Map(objects.map((o) => [o.id, o.color])) : null;
  const marks = runData.marks.filter((m) => !hidden.has(m.tone));
  const curves = objects.filter((o) => focus == null || o.id === focus).map((o) => ({
    color: several ? o.color : STAGE_COLORS.best,
    points: rowsOf(runData, o.id).map((r) => [r.k, r.best.score]),
    first: Math.max(...startsOf(runData, o).map((a) => a.score ?? 0)),
  }));
  const dots = focus == null ? [] : cells.filter((c) => c.obj === focus && c.score != null);
  const answers = runData.over ? [...last.values()].map(({ obj: id, best }) => ({ obj: id, ...best }))
    .filter((b) => b.k) : [];
  return { answers, band, chosen, total: Math.max(total, rows.length, 1), done: rows.length, cells, lanes, marks,
    curves, dots, several, focus };
}

function Strip() {
  const host = useRef();
  const canvas = useRef();
  const [size, setSize] = useState(null);
  const [hover, setHover] = useState(null);
  const [frame, runData, obj, by, hidden, arm, theme] = useStore((s) => [
    s.frame, runOf(s), s.view.obj, colorByOf(s), hiddenOf(s), s.view.arm, s.theme,
  ]);
  const model = useMemo(() => frame && modelOf(frame, runData, obj, by, hidden, arm),
    [frame, runData, obj, by, hidden, arm]);
  useEffect(() => {
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
  const name = (id) => frame.objects.find((o) => o.id === id)?.label ?? "";
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

function Hint({ hover, row, k, marks, name, width }) {
  if (!row) return html`<div class="hint"
    style=${{ left: `${hover.x}px`, top: "0" }}>iteration ${k}: not computed yet</div>`;
  const side = hover.x > width / 2 ? { right: `${width - hover.x + 12}px` } : { left: `${hover.x + 12}px` };
  const stage = row.stages.find((s) => s.name === row.accepted);
  const error = stage?.err != null ? ` · ${number(stage.err, 1)} mm` : "";
  return html`<div class="hint" style=${{ ...side, bottom: "0.5rem" }}>
    <b>iteration ${k}</b>${name && html` · ${name(row.obj)}`} · hypothesis ${row.arm + 1}
    <div>${row.accepted} accepted · score ${number(stage?.score, 3)}${error}</div>
    ${marks.map((m) => html`<div class="mark"><svg viewBox="-6 -6 12 12"><path
      d=${SHAPES[TONES[m.tone]?.shape ?? "circle"]}
      fill=${TONES[m.tone]?.color ?? "currentColor"} /></svg>${m.text}</div>`)}
  </div>`;
}

const MARK_ROWS = [["problem"], ["rejected", "flip", "edited"], ["switched", "best"]];

// Where everything lies [px].
function placeOf(model, [w, h, rem, ratio]) {
  const longest = Math.max(...model.lanes.map((l) => l.name.length), 6);
  const left = Math.round(Math.min(rem * 11.5, rem * (1.4 + 0.53 * longest)) + (model.several ? rem : 0));
  const band = model.band ? Math.round(rem * 0.6) : 0;
  const right = Math.round(rem * 2.6);
  const marksTop = Math.round(rem * 0.9);
  const groups = MARK_ROWS.filter((tones) => model.marks.some((m) => tones.includes(m.tone)));
  const mark = Math.round(rem * 0.8);
  const marks = groups.length * mark + Math.round(rem * 0.25) + band;
  const axis = Math.round(rem * 1.15);
  const room = Math.max(0, h - marksTop - marks - axis);
  const n = Math.max(model.lanes.length, 1);
  const most = room * (model.several && !model.chosen ? 0.6 : 0.52);
  const strip = most / n < rem * 0.5;
  const lane = strip ? Math.min(rem * 1.3, room * 0.35) : Math.min(most / n, rem * 1.3);
  const lanesTop = marksTop + marks;
  const lanes = strip ? lane : lane * n;
  const curveTop = lanesTop + lanes + rem * 0.5;
  return {
    w, h, rem, ratio, left, right, marksTop, mark, groups, band, lanesTop, lane, lanes, strip, curveTop,
    curveBottom: h - axis - rem * 0.2, cell: (w - left - right) / model.total,
  };
}

// A text with its end left out where it is wider than there is room.
function shortened(ctx, text, room) {
  let n = text.length;
  while (n > 1 && ctx.measureText(n < text.length ? `${text.slice(0, n)}…` : text).width > room) n -= 1;
  return n < text.length ? `${text.slice(0, n)}…` : text;
}

function draw(canvas, model, p) {
  const { w, h, rem, ratio, left, cell } = p;
  canvas.width = Math.round(w * ratio);
  canvas.height = Math.round(h * ratio);
  Object.assign(canvas.style, { width: `${w}px`, height: `${h}px` });
  const ctx = canvas.getContext("2d");
  ctx.scale(ratio, ratio);
  const css = getComputedStyle(canvas);
  const [text, dim, line] = ["--text", "--dim", "--line"].map((n) => css.getPropertyValue(n));
  const font = (size) => (ctx.font = `${(size * rem).toFixed(1)}px ${css.fontFamily}`);
  const right = w - p.right;
  const x = (k) => left + (k - 0.5) * cell;
  ctx.textBaseline = "middle";

  // Lanes: hairlines over all of the run, cells where there was an iteration.
  const gap = cell > 4 ? Math.min(1, cell * 0.2) : 0;
  model.lanes.forEach((lane, i) => {
    if (p.strip && i) return;
    const top = p.lanesTop + i * p.lane;
    ctx.fillStyle = line;
    ctx.fillRect(left, Math.round(top + p.lane) - 1, right - left, 1);
    font(lane.color ? Math.min(0.86, p.lane / rem) : 0.86);
    ctx.textAlign = "left";
    ctx.fillStyle = dim;
    if (p.strip) {
      return ctx.fillText(`${model.lanes.length} ${model.chosen ? "hyp." : "objects"}`, rem * 0.7, top + p.lane / 2);
    }
    let from = rem * 0.7;
    if (lane.color) {
      ctx.fillStyle = lane.color;
      ctx.fillRect(from, top + p.lane / 2 - rem * 0.28, rem * 0.56, rem * 0.56);
      from += rem * 0.9;
      ctx.fillStyle = text;
    }
    if (lane.color || p.lane >= rem * 0.8 || i % 2 === 0) {
      ctx.fillText(shortened(ctx, lane.name, left - rem * 0.5 - from), from, top + p.lane / 2);
    }
    return undefined;
  });
  const colors = model.lanes.find((l) => l.color) && p.strip;
  if (model.band) {
    for (const c of model.cells) {
      ctx.fillStyle = model.band.get(c.obj);
      ctx.fillRect(x(c.k) - cell / 2, p.lanesTop - p.band, cell + 0.3, p.band - 2);
    }
  }
  for (const c of model.cells) {
    if (model.chosen && c.obj !== model.chosen.id) continue;
    const i = p.strip ? 0 : model.lanes.findIndex((l) => l.has(c));
    if (i < 0) continue;
    ctx.globalAlpha = c.faint ? 0.22 : 1;
    ctx.fillStyle = colors ? model.lanes.find((l) => l.has(c)).color : rampColor(c.share);
    ctx.fillRect(x(c.k) - cell / 2 + gap / 2, p.lanesTop + i * p.lane + 1, Math.max(cell - gap, 0.8), p.lane - 2.5);
  }
  ctx.globalAlpha = 1;
  ctx.strokeStyle = STAGE_COLORS.best;
  ctx.lineWidth = Math.max(2, rem * 0.14);
  for (const c of model.answers) {
    if (model.chosen && c.obj !== model.chosen.id) continue;
    const i = p.strip ? 0 : model.lanes.findIndex((l) => l.has(c));
    ctx.strokeRect(x(c.k) - Math.max(cell, 5) / 2, p.lanesTop + i * p.lane + 0.5, Math.max(cell, 5), p.lane - 1.5);
  }

  // The curve: the best so far as steps, accepted poses as points.
  const values = [...model.dots.map((d) => d.score),
    ...model.curves.flatMap((c) => [c.first, ...c.points.map((q) => q[1])])]
    .filter((v) => v != null);
  const [top, bottom] = [p.curveTop, p.curveBottom];
  if (bottom - top > rem && values.length) {
    const low = Math.max(0, Math.floor(Math.min(...values) * 10 - 0.3) / 10);
    const high = Math.min(1, Math.ceil(Math.max(...values) * 10 + 0.3) / 10);
    const y = (v) => bottom - ((v - low) / (high - low || 1)) * (bottom - top);
    font(0.86);
    ctx.fillStyle = dim;
    ctx.textAlign = "left";
    ctx.fillText("score", rem * 0.7, (top + bottom) / 2);
    for (const v of bottom - top > rem * 3.5 ? [low, (low + high) / 2, high] : [low, high]) {
      ctx.fillStyle = line;
      ctx.fillRect(left, Math.round(y(v)), right - left, 1);
      ctx.fillStyle = dim;
      ctx.fillText(v.toFixed(2), right + rem * 0.4, Math.max(top + rem * 0.3, Math.min(bottom - rem * 0.2, y(v))));
    }
    ctx.lineWidth = Math.max(1, rem * 0.1);
    for (const curve of model.curves) {
      ctx.strokeStyle = curve.color;
      ctx.beginPath();
      let last = y(curve.first);
      ctx.moveTo(left, last);
      for (const [k, v] of curve.points) {
        ctx.lineTo(x(k), last);
        ctx.lineTo(x(k), (last = y(v)));
      }
      ctx.lineTo(left + model.done * cell, last);
      ctx.stroke();
    }
    ctx.strokeStyle = dim;
    ctx.lineWidth = 1;
    ctx.globalAlpha = 0.45;
    ctx.beginPath();
    model.dots.forEach((d, i) => (i ? ctx.lineTo(x(d.k), y(d.score)) : ctx.moveTo(x(d.k), y(d.score))));
    ctx.stroke();
    const r = Math.max(1.5, Math.min(rem * 0.22, cell * 0.3));
    for (const d of model.dots) {
      ctx.globalAlpha = d.faint ? 0.2 : 1;
      ctx.fillStyle = rampColor(d.share);
      ctx.beginPath();
      ctx.arc(x(d.k), y(d.score), r, 0, 7);
      ctx.fill();
    }
    ctx.globalAlpha = 1;
    ctx.strokeStyle = STAGE_COLORS.best;
    ctx.lineWidth = Math.max(2, rem * 0.14);
    for (const c of model.answers.filter((one) => model.focus == null || one.obj === model.focus)) {
      ctx.beginPath();
      ctx.arc(x(c.k), y(c.score), r + 2.5, 0, 7);
      ctx.stroke();
    }
  }

  // Marks, a row for each kind.
  const half = Math.max(3, Math.min(rem * 0.4, 0.6 * cell + 1.5));
  const at = new Map();
  for (const m of model.marks) {
    const { color, shape } = TONES[m.tone] ?? { color: dim, shape: "circle" };
    const row = p.groups.findIndex((tones) => tones.includes(m.tone));
    const n = at.get(`${m.k} ${row}`) ?? 0;
    at.set(`${m.k} ${row}`, n + 1);
    ctx.save();
    ctx.globalAlpha = model.focus != null && m.obj !== model.focus ? 0.25 : 1;
    ctx.translate(x(m.k) + n * Math.min(half * 2, cell / 2), p.marksTop + p.mark * (row + 0.5));
    ctx.scale(half / 5, half / 5);
    ctx.fillStyle = color;
    ctx.fill((PATHS[shape] ??= new Path2D(SHAPES[shape])));
    ctx.restore();
  }

  // The axis of iterations.
  font(0.86);
  ctx.textAlign = "center";
  ctx.fillStyle = dim;
  const every = [1, 2, 5, 10, 20, 25, 50, 100, 200, 500, 1000].find((n) => n * cell > rem * 3) ?? 1000;
  for (let k = every; k <= model.total; k += every) ctx.fillText(k, x(k), h - rem * 0.6);
  ctx.textAlign = "left";
  ctx.fillText("iteration", rem * 0.7, h - rem * 0.6);
  if (model.done < model.total) {
    ctx.strokeStyle = line;
    ctx.setLineDash([3, 3]);
    ctx.beginPath();
    ctx.moveTo(left + model.done * cell, p.marksTop);
    ctx.lineTo(left + model.done * cell, bottom);
    ctx.stroke();
  }
}
