// The image pane: photo or depth, a map or the shaded model over it, outlines of poses; wiped, blinked, measured; and a
// pose that is moved by the mouse.
import { html, useEffect, useLayoutEffect, useRef, useState } from "./vendor/htm-preact.js";
import { state, setView, update, send, listen, useStore } from "./store.js";
import { momentOf } from "./moment.js";
import { Pane, Button, Select, Swatch } from "./ui.js";
import { addKeys } from "./keys.js";
import { toast } from "./toasts.js";
import { MAPS, CLASSES, valueText } from "./colours.js";
import { sidesOf, readAt, photo, colourAt, observedDepth, hasColour } from "./sides.js";
import { prepareAhead } from "./outlines.js";
import { contoursOf, depthAt, draw } from "./drawing.js";
import { between, dragged, origin, project, displaced, displacement, receded, shifted, turned } from "./pose.js";

const MARGIN = 0.25; // shown around the object, as a share of its size
const NEAR_PX = 7; // how near the divider is taken
const FAR_PX = 3; // a click that moved more is a drag
const TURN = (0.4 * Math.PI) / 180; // radians a pixel of a drag
const NOTCH_MM = 1;
const FINE = 0.2; // with Shift
const BLINK_MS = 450;
const DEFAULTS = {
  under: "photo", // or depth
  over: "none", // shaded, or the name of a map
  side: "b", // whose
  opacity: 0.75,
  wipe: "off", // photo: picture | what is over it; ab: A | B
  at: 0.5, // of the width, where the divider is
  blink: null, // whether the model is shown just now; null = it does not blink
  hidden: ["hypotheses", "mask"],
};
const layersOf = (s) => ({ ...DEFAULTS, ...s.view.layers });
const setLayers = (patch) => setView({ layers: { ...layersOf(state), ...patch } });
const shownSides = (s) => sidesOf(momentOf(s));

// Where the image is in the pane: a scale [CSS pixels a pixel] and the place of pixel 0, 0. `zoom` is null (the object
// is fitted in), "image", or a middle and a scale relative to the fitted image: all follow the size of the window.

function placeOf(zoom, size, camera, box) {
  const whole = Math.min(size.w / camera.w, size.h / camera.h);
  if (zoom && zoom !== "image") {
    const scale = zoom.share * whole;
    return { scale, x: size.w / 2 - zoom.u * scale, y: size.h / 2 - zoom.v * scale };
  }
  const fitsObject = box && zoom !== "image";
  const [u0, v0, u1, v1] = fitsObject ? box : [0, 0, camera.w, camera.h];
  const around = 1 + 2 * (fitsObject ? MARGIN : 0);
  const scale = Math.max(Math.min(size.w / (u1 - u0), size.h / (v1 - v0)) / around, whole);
  // The middle of the box in the middle; but nothing beside the image where there is enough of it.
  const start = (all, area, middle) =>
    scale * all > area
      ? Math.min(Math.max(area / 2 - scale * middle, area - scale * all), 0)
      : (area - scale * all) / 2;
  return { scale, x: start(camera.w, size.w, (u0 + u1) / 2), y: start(camera.h, size.h, (v0 + v1) / 2) };
}

const zoomOf = (place, size, camera) => ({
  share: place.scale / Math.min(size.w / camera.w, size.h / camera.h),
  u: (size.w / 2 - place.x) / place.scale,
  v: (size.h / 2 - place.y) / place.scale,
});

// Closer by a factor, about a point of the pane.
export function zoomed(place, factor, { x, y }, least, most) {
  const scale = Math.min(Math.max(place.scale * factor, least), most);
  const by = scale / place.scale;
  return { scale, x: x - (x - place.x) * by, y: y - (y - place.y) * by };
}
const fitNext = () => setView({ zoom: state.view.zoom == null ? "image" : null });

// Numbers of the marked pixel, else of the one under the mouse, straight from the arrays

const OF_PIXEL = [["rendered", "model", 6.2], ["difference", "Δ mm", 5], ["angle", "∠", 2.6], ["f_d", "f_d", 3],
  ["f_n", "f_n", 3], ["correlation", "corr.", 4.2], ["classes", "", 7.5]]; // map, words, width in digits

function Numbers() {
  const [sides, pixel] = useStore((s) => [shownSides(s), s.view.pixel ?? s.hover, photo(), observedDepth()]);
  const colour = pixel && colourAt(pixel);
  const depth = pixel && depthAt(pixel);
  const maps = OF_PIXEL.filter(([name]) => name !== "correlation" || hasColour(sides));
  const adds = (side) =>
    `½ (f_d + f_n); its mean over the ${side.score?.n ?? 0} pixels that count is the score without colour`;
  return html`<div class="pixel-numbers">
    <div><b class="at">${pixel ? pixel.join(", ") : "pixel"}</b>
      <span>observed <i>${depth ? `${depth.toFixed(4)} m` : "–"}</i></span>
      ${state.frame.rgb && html`<span>colour <i>${colour
        ? html`<em style=${{ background: `rgb(${colour})` }} />${colour.join(" ")}` : "–"}</i></span>`}</div>
    ${[sides.a, sides.b].filter(Boolean).map((side) => html`<div key=${side.letter}>
      <b class=${`letter ${side.letter}`}>${side.letter.toUpperCase()}</b>
      ${maps.map(([name, words, width]) => html`<span class=${name} title=${MAPS[name].hint}>${words} <i
        style=${{ minWidth: `${width}ch` }}>${numberOf(name, side, pixel)}</i></span>`)}
      <span class="adds" title=${adds(side)}>adds <i>${fitOf(side, pixel)}</i></span></div>`)}
  </div>`;
}
function numberOf(name, side, pixel) {
  if (side.stale) return side.gone ? "–" : "…";
  const value = readAt(name, side, pixel);
  if (value == null) return "–";
  if (name !== "classes") return `${valueText(MAPS[name], value)}${name === "angle" ? "°" : ""}`;
  return html`<em style=${{ background: CLASSES.find((c) => c.name === value).color }} />${value}`;
}
function fitOf(side, pixel) {
  const [f_d, f_n] = ["f_d", "f_n"].map((name) => (side.stale ? null : readAt(name, side, pixel)));
  return f_d == null ? "–" : ((f_d + f_n) / 2).toFixed(2);
}

// Editing a pose

const editable = ({ poses }) => (state.view.edited ? null : poses.edited) ?? poses.accepted ?? poses.current ?? poses.best ?? poses.initial;
export function toggleEdit() {
  if (state.view.edited) return setView({ edited: null });
  const moment = momentOf(state);
  const pose = moment && editable(moment);
  if (!pose?.T) return undefined;
  return setView({ edited: { obj: moment.obj, arm: pose.arm ?? moment.arm, T: pose.T, from: pose.T } });
}
const moveTo = (T) => setView({ edited: { from: editable(momentOf(state)).T, ...state.view.edited, T } });
function nudge(event, x, y) {
  const m = (NOTCH_MM / 1000) * (event?.shiftKey ? FINE : 1);
  moveTo(shifted(state.view.edited.T, [x * m, y * m, 0]));
}
function proceed(moment) {
  const { obj, arm, T } = state.view.edited;
  // The server takes the edited pose from the view once it is in a branch.
  send({ verb: "fork", branch: moment.branch, k: moment.k, changes: {}, edit: { obj, arm, T } });
}

// A moved pose that goes because another moment is shown can be taken back.
let last = state.view;
listen(() => {
  const [before, now] = [last, state.view];
  last = now;
  const { edited, branch, k } = before;
  const isLost = edited?.from && !now.edited && now.branch === branch && now.k !== k && state.frame;
  if (!isLost || edited.T.every((x, i) => Math.abs(x - edited.from[i]) < 1e-5)) return;
  const { id } = state.frame;
  const back = () => state.frame?.id === id && setView({ branch, k, obj: edited.obj, stage: null, moment: null, edited });
  toast("note", "The edited pose was left.", { offer: { words: "Take it back", action: back } });
});

// The edited pose in numbers, to read and to type: how far it was moved and turned from where the editing began.
function Displacement({ from, T }) {
  const [axes, setAxes] = useState("camera");
  const [shift, turn] = displacement(from, T, axes);
  const field = (value, i, list, type) => html`<input key=${i} type="text" inputmode="decimal" aria-label=${`${type} ${"xyz"[i]}`}
    title=${`${type} ${"xyz"[i]}`} value=${(Math.round(value * 100) / 100 + 0).toString()} onChange=${(e) => {
      const typed = Number(e.currentTarget.value.replace("−", "-"));
      const next = list.map((x, j) => (j === i ? typed : x)); // what is not typed keeps its hidden decimals
      const most = type === "moved" ? 10000 : 180;
      if (Number.isFinite(typed) && Math.abs(typed) <= most) moveTo(displaced(from, ...(list === shift ? [next, turn] : [shift, next]), axes));
      e.currentTarget.value = value.toFixed(2);
    }} />`;
  return html`<span class="numbers"><${Select} value=${axes} options=${[["camera", "camera axes"], ["object", "object axes"]]} onChange=${setAxes}
      title="camera: x to the right, y down, z away. object: those of its model, as it was" />
    mm ${shift.map((v, i) => field(v, i, shift, "moved"))} ° ${turn.map((v, i) => field(v, i, turn, "turned"))}</span>`;
}

function EditLine() {
  const [moment, sides, edit] = useStore((s) => [momentOf(s), shownSides(s), s.view.edited]);
  if (!edit || !moment) return null;
  const { T, arm, from = editable(moment).T } = edit;
  const { mm, deg } = between(from, T);
  const now = [sides.a, sides.b].find((side) => side?.pose.name === "edited");
  const before = editable(moment).score;
  return html`<div class="editing">
    <span>hypothesis ${arm + 1} moved <b>${mm.toFixed(1)} mm</b> <b>${deg.toFixed(1)}°</b></span>
    <span>score <b>${now && !now.stale ? now.score.score.toFixed(3) : "…"}</b>
      ${before != null && html` <i>from ${before.toFixed(3)}</i>`}</span>
    <${Displacement} from=${from} T=${T} />
    <${Button} engine kind="primary" title="a new branch from this pose"
      onClick=${() => proceed(moment)}>Continue from here<//>
    <${Button} title="back to where it began" disabled=${mm + deg === 0} onClick=${() => moveTo(from)}>Reset<//>
    <${Button} title="stop editing (Esc)" onClick=${() => setView({ edited: null })}>Cancel<//>
    <i class="how" title="arrows: 1 mm; with Shift wheel and arrows 0.2 mm">drag: move · wheel: depth · Shift: turn · Alt: spin</i>
  </div>`;
}

// Mouse

export const setHover = (pixel) => String(pixel) === String(state.hover ?? null) || update({ hover: pixel });
export const markPixel = (pixel) => setView({ pixel: String(pixel) === String(state.view.pixel) ? null : pixel });
export function inImage(u, v) {
  const { w, h } = state.frame.camera;
  const pixel = [Math.floor(u), Math.floor(v)];
  return pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] < w && pixel[1] < h ? pixel : null;
}

// `here.current` holds the pane's size, where the image is in it, and the drag that goes on.
function handlers(canvas, here) {
  const at = (event) => {
    const box = canvas.current.getBoundingClientRect();
    const { place } = here.current;
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const [u, v] = [(x - place.x) / place.scale, (y - place.y) / place.scale];
    return { x, y, u, v, pixel: inImage(u, v) };
  };
  const overDivider = (x) => {
    const { wipe, at: share } = layersOf(state);
    return wipe !== "off" && Math.abs(x - share * here.current.size.w) < NEAR_PX;
  };
  const setPlace = (place) => setView({ zoom: zoomOf(place, here.current.size, state.frame.camera) });
  const kindOf = (event, start) => {
    if (overDivider(start.x)) return "wipe";
    if (!state.view.edited) return event.shiftKey ? "ruler" : "pan";
    return event.shiftKey ? "turn" : event.ctrlKey || event.altKey ? "spin" : "move";
  };
  const drags = {
    wipe: ({ now }) => setLayers({ at: Math.min(Math.max(now.x / here.current.size.w, 0), 1) }),
    pan: ({ place, dx, dy }) => setPlace({ scale: place.scale, x: place.x + dx, y: place.y + dy }),
    ruler: ({ start, now }) => setView({ ruler: start.pixel && now.pixel ? [start.pixel, now.pixel] : null }),
    move: ({ T, place, dx, dy }) => moveTo(dragged(T, dx / place.scale, dy / place.scale, state.frame.camera.K)),
    turn: ({ T, dx, dy }) => moveTo(turned(turned(T, [0, -1, 0], dx * TURN), [1, 0, 0], dy * TURN)),
    spin: ({ T, start, now }) => {
      const [u, v] = project(origin(T), state.frame.camera.K);
      const angle = (p) => Math.atan2(p.v - v - 0.5, p.u - u - 0.5);
      moveTo(turned(T, origin(T), angle(now) - angle(start)));
    },
  };

  const onPointerDown = (event) => {
    if (event.button !== 0) return;
    const start = at(event);
    const { place } = here.current;
    here.current.drag = { kind: kindOf(event, start), start, place, T: state.view.edited?.T, far: false };
    canvas.current.setPointerCapture(event.pointerId);
  };
  const onPointerMove = (event) => {
    const now = at(event);
    const { drag } = here.current;
    setHover(now.pixel);
    const isWipe = drag ? drag.kind === "wipe" : overDivider(now.x);
    canvas.current.style.cursor = isWipe ? "ew-resize" : state.view.edited ? "move" : "crosshair";
    if (!drag) return;
    const [dx, dy] = [now.x - drag.start.x, now.y - drag.start.y];
    drag.far ||= Math.hypot(dx, dy) > FAR_PX;
    if (drag.far || drag.kind === "wipe") drags[drag.kind]({ ...drag, now, dx, dy });
  };
  const onPointerUp = () => {
    const { drag } = here.current;
    here.current.drag = null;
    if (!drag || drag.far || !["pan", "ruler"].includes(drag.kind)) return;
    if (state.view.ruler) setView({ ruler: null });
    if (drag.start.pixel) markPixel(drag.start.pixel);
  };
  const onWheel = (event) => {
    event.preventDefault();
    if (state.view.edited && !event.ctrlKey) {
      const mm = Math.sign(event.deltaY || event.deltaX) * NOTCH_MM * (event.shiftKey ? FINE : 1);
      return moveTo(receded(state.view.edited.T, -mm / 1000));
    }
    const { place, size } = here.current;
    const fit = Math.min(size.w / state.frame.camera.w, size.h / state.frame.camera.h);
    return setPlace(zoomed(place, Math.exp(-0.0016 * event.deltaY), at(event), 0.5 * fit, 60 * fit));
  };
  const onDblClick = () => {
    setView({ pixel: null });
    fitNext();
  };
  const onPointerCancel = () => (here.current.drag = null);
  const onPointerLeave = () => here.current.drag || setHover(null);
  return { onPointerDown, onPointerMove, onPointerUp, onPointerCancel, onPointerLeave, onWheel, onDblClick };
}

// Keys

function toggleOutline(key) {
  const { hidden } = layersOf(state);
  setLayers({ hidden: hidden.includes(key) ? hidden.filter((k) => k !== key) : [...hidden, key] });
}
const blink = () => layersOf(state).blink == null && setLayers({ blink: true });
const KEYS = [
  { id: "edit", keys: ["p"], title: "Edit the pose in the image", group: "Image", action: toggleEdit,
    when: () => !state.file },
  { id: "blink", keys: ["v"], title: "Hold: photo and shaded model in turn", group: "Image", action: blink },
  { id: "hypotheses", keys: ["h"], title: "Outlines of the hypotheses on or off", group: "Image",
    action: () => toggleOutline("hypotheses") },
  { id: "truth", keys: ["u"], title: "Outline of the ground truth on or off", group: "Image",
    action: () => toggleOutline("ground truth"), when: () => Boolean(momentOf(state)?.object.gt) },
  { id: "fit", keys: ["o"], title: "Fit the object, or the whole image", group: "Image", action: fitNext },
];
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const ARROWS = Object.entries(WAYS).map(([key, way]) =>
  ({ id: key, keys: [key], title: "Move the edited pose by 1 mm", group: "Image", action: (event) => nudge(event, ...way) }));
function useKeys() {
  const [edits, blinks, isOver] = useStore((s) =>
    [Boolean(s.view.edited), layersOf(s).blink != null, s.hoverIn === "image"]);
  useEffect(() => addKeys(KEYS), []);
  useEffect(() => (edits && isOver ? addKeys(ARROWS) : undefined), [edits, isOver]);
  useEffect(() => {
    if (!blinks) return undefined;
    const timer = setInterval(() => setLayers({ blink: !layersOf(state).blink }), BLINK_MS);
    const letGo = (e) => e.key.toLowerCase() === "v" && setLayers({ blink: null });
    addEventListener("keyup", letGo);
    return () => {
      clearInterval(timer);
      removeEventListener("keyup", letGo);
    };
  }, [blinks]);
}

// The pane

// Size of an element in CSS pixels, and of a rem.
export function useSize() {
  const root = useRef();
  const [size, setSize] = useState(null);
  useLayoutEffect(() => {
    const measure = () => {
      const { width: w, height: h } = root.current.getBoundingClientRect();
      const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
      setSize((before) => (before?.w === w && before.h === h && before.rem === rem ? before : { w, h, rem }));
    };
    const observer = new ResizeObserver(measure);
    observer.observe(root.current);
    measure();
    return () => observer.disconnect();
  }, []);
  return [root, size];
}
export function fitCanvas(canvas, size) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const [w, h] = [Math.max(1, Math.round(size.w * ratio)), Math.max(1, Math.round(size.h * ratio))];
  if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
}

export function ImagePane() {
  const frame = useStore((s) => s.frame);
  return html`<${Pane} name="image" title="Image" tools=${html`<${Tools} />`}>${frame ? html`<${Picture} />` : ""}<//>`;
}

function Tools() {
  const [moment, sides] = useStore((s) => [momentOf(s), shownSides(s), s.view.layers]);
  if (!moment) return null;
  const layers = layersOf(state);
  const { side, opacity } = layers;
  const isThere = (name) => (!MAPS[name].colour || hasColour(sides)) && (name !== "gain" || sides.b);
  const maps = Object.keys(MAPS).filter((name) => name !== "observed" && isThere(name));
  const labels = maps.map((name) => [name, MAPS[name].label]);
  const overs = [["none", "no overlay"], ["shaded", "shaded model"], ...labels];
  const wipes = [["off", "no wipe"], ["photo", `${state.frame.rgb ? "photo" : "depth"} | model`], ["ab", "A | B"]];
  return html`
    <${Select} title="what is laid over the picture" value=${layers.over} options=${overs}
      onChange=${(over) => setLayers({ over })} />
    ${sides.b && html`<${Button} kind="square" onClick=${() => setLayers({ side: side === "a" ? "b" : "a" })}
      title=${`of pose ${side.toUpperCase()}; click for the other`}>
      <b class=${`letter ${side}`}>${side.toUpperCase()}</b><//>`}
    <input type="range" class="opacity" min="0" max="1" step="0.05" value=${opacity} title="its opacity"
      onInput=${(e) => setLayers({ opacity: +e.currentTarget.value })} onChange=${(e) => e.currentTarget.blur()} />
    <${Select} title="wipe: a divider to drag" value=${layers.wipe} options=${sides.b ? wipes : wipes.slice(0, 2)}
      onChange=${(wipe) => setLayers({ wipe })} />`;
}

function Picture() {
  const [root, size] = useSize();
  const canvas = useRef();
  const here = useRef({});
  const paint = useRef();
  paint.current = () => {
    const moment = momentOf(state);
    if (!size || !moment || !canvas.current) return;
    const place = placeOf(state.view.zoom ?? null, size, state.frame.camera, moment.object.box);
    Object.assign(here.current, { size, place });
    fitCanvas(canvas.current, size);
    draw(canvas.current, size, place, moment, sidesOf(moment), layersOf(state));
    prepareAhead();
  };
  // Whatever changes, it is drawn at most once per animation frame: the store takes care of that.
  useEffect(() => listen(() => paint.current()), []);
  useLayoutEffect(() => paint.current(), [size]);
  useKeys();
  return html`<div class="picture">
    <div class="stage" ref=${root} onPointerEnter=${() => update({ hoverIn: "image" })}
      onPointerLeave=${() => update({ hoverIn: null })}>
      <canvas ref=${canvas} ...${handlers(canvas, here)} />
      <${Legend} /><${Acts} /><${WipeNames} /><${EditLine} />
    </div>
    <${Numbers} />
  </div>`;
}

// Buttons that lie over the image.
function Acts() {
  const [zoom, edits, layers] = useStore((s) => [s.view.zoom, Boolean(s.view.edited), s.view.layers]);
  const { under, blink: blinks } = { ...DEFAULTS, ...layers };
  return html`<div class="acts">
    ${state.frame.rgb && html`<${Button} title="observed depth instead of the photo" on=${under === "depth"}
      onClick=${() => setLayers({ under: under === "depth" ? "photo" : "depth" })}>Depth<//>`}
    <${Button} title="photo and shaded model in turn (hold V)" on=${blinks != null}
      onClick=${() => setLayers({ blink: blinks == null ? true : null })}>Blink<//>
    <${Button} title="fit the object, or the whole image (O, or double click)" onClick=${fitNext}>
      ${zoom == null ? "Whole" : "Object"}<//>
    <${Button} engine title="move the pose by the mouse (P)" on=${edits} onClick=${toggleEdit}>Edit pose<//></div>`;
}

function Legend() {
  const [moment] = useStore((s) => [momentOf(s), s.view.layers]);
  if (!moment) return null;
  const { hidden } = layersOf(state);
  const entry = ({ key, color, dashed, label }) => html`
    <button type="button" key=${key} class=${hidden.includes(key) ? "off" : ""} title="show or hide this outline"
      onClick=${(e) => { e.currentTarget.blur(); toggleOutline(key); }}>
      <${Swatch} color=${color} hollow=${dashed} /><span>${label}</span></button>`;
  return html`<div class="legend">${contoursOf(moment).map(entry)}</div>`;
}

function WipeNames() {
  const layers = useStore((s) => (layersOf(s).wipe === "off" ? null : s.view.layers));
  if (!layers) return null;
  const { wipe, over, at, under } = layersOf(state);
  const model = MAPS[over]?.label ?? "shaded model";
  const names = wipe === "ab" ? [`A ${model}`, `B ${model}`] : [state.frame.rgb ? under : "depth", model];
  const left = `${100 * at}%`;
  return html`<div class="wiped">${names.map((name) => html`<span style=${{ left }}>${name}</span>`)}</div>`;
}
