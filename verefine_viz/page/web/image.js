// The image pane: photo or depth, with a map or the shaded model and outlines of poses over it; wiping, blinking,
// measuring; and moving a pose by the mouse.
import { html } from "htm/preact";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { state, setView, update, listen, useStore } from "./store.js";
import { momentOf } from "./moment.js";
import { Pane, Button, Select, Swatch } from "./ui.js";
import { addKeys } from "./keys.js";
import { MAPS, valueText } from "./colours.js";
import { palette } from "./palette.js";
import { sidesOf, readAt, photo, colourAt, observedDepth, hasColour } from "./sides.js";
import { mark } from "./marking.js";
import { outlineOf, prepareAhead } from "./outlines.js";
import { DoubtCard } from "./doubt_card.js";
import { shownDoubt } from "./doubts.js";
import { contoursOf, depthAt, draw, isOutlined } from "./drawing.js";
import { isChosenBySense, isToBlame, toggleDrawn } from "./drawn_unasked.js";
import { edit, EditBar, moveTo, toggleEdit, turnedBy, useEditKeys } from "./editing.js";
import { ask, labelInHand, modelInHand, sketchAt, sketchedTo } from "./labelling.js";
import { dragged, origin, project, receded, turned } from "./pose.js";

const MARGIN = 0.25; // shown around the object, as a share of its size
const LEGEND = 11.5; // rem, left of the object; a narrow pane gives it less
const LEGEND_SHARE = 0.33;
const NEAR_PX = 7; // how near a press takes the divider
const FAR_PX = 3; // a click that moved more is a drag
const TURN = (0.4 * Math.PI) / 180; // radians a pixel of a drag
const NOTCH_MM = 1;
const FINE = 0.2; // with Shift
const BLINK_MS = 450;
const DEFAULTS = {
  under: "photo", // or depth
  over: "none", // shaded, or the name of a map
  side: null, // whose map or model; null = the answer's where the other is ground truth
  opacity: 0.75,
  wipe: "off", // photo: picture | overlay; ab: A | B
  at: 0.5, // place of the divider, as a share of the width
  blink: null, // what is shown just now: photo, a or b; null = nothing blinks
  hidden: ["hypotheses", "mask", "plane"],
};
const layersOf = (s) => {
  const moment = momentOf(s);
  const hidden = DEFAULTS.hidden.filter((key) => !isToBlame(moment, key));
  const layers = { ...DEFAULTS, hidden, ...s.view.layers };
  return { ...layers, side: layers.side ?? (moment?.b?.name === "ground truth" ? "a" : "b") };
};
const setLayers = (patch) => setView({ layers: { ...state.view.layers, ...patch } });
const shownSides = (s) => sidesOf(momentOf(s));

// Place of the image in the pane: its scale [CSS pixels per pixel] and the position of pixel 0, 0. `zoom` is null (the
// object is fitted in), "image", or a middle and a scale relative to the fitted image: all follow the window's size.

function placeOf(zoom, size, camera, box) {
  const whole = Math.min(size.w / camera.w, size.h / camera.h);
  if (zoom && zoom !== "image") {
    const scale = zoom.share * whole;
    return { scale, x: size.w / 2 - zoom.u * scale, y: size.h / 2 - zoom.v * scale };
  }
  const fitsObject = box && zoom !== "image";
  const [u0, v0, u1, v1] = fitsObject ? box : [0, 0, camera.w, camera.h];
  const around = 1 + 2 * (fitsObject ? MARGIN : 0);
  const left = fitsObject ? Math.min(LEGEND * size.rem, LEGEND_SHARE * size.w) : 0;
  const scale = Math.max(Math.min((size.w - left) / (u1 - u0), size.h / (v1 - v0)) / around, whole);
  // The box is centred in the space beside the legend, unless the image would then leave part of the pane empty.
  const start = (all, area, middle, from = 0) =>
    scale * all > area
      ? Math.min(Math.max((from + area) / 2 - scale * middle, area - scale * all), 0)
      : (area - scale * all) / 2;
  return { scale, x: start(camera.w, size.w, (u0 + u1) / 2, left), y: start(camera.h, size.h, (v0 + v1) / 2) };
}

const zoomOf = (place, size, camera) => ({
  share: place.scale / Math.min(size.w / camera.w, size.h / camera.h),
  u: (size.w / 2 - place.x) / place.scale,
  v: (size.h / 2 - place.y) / place.scale,
});

// Zooms in by a factor, about a point of the pane.
export function zoomed(place, factor, { x, y }, least, most) {
  const scale = Math.min(Math.max(place.scale * factor, least), most);
  const by = scale / place.scale;
  return { scale, x: x - (x - place.x) * by, y: y - (y - place.y) * by };
}
const fitNext = () => setView({ zoom: state.view.zoom == null ? "image" : null });

// Numbers of the marked pixel, else of the one under the mouse, straight from the arrays

/** @type {[string, string, number][]} */
const OF_PIXEL = [["rendered", "model", 6.2], ["difference", "Δ mm", 5], ["angle", "∠", 2.6], ["f_d", "f_d", 3],
  ["f_n", "f_n", 3], ["correlation", "f_c", 4.2], ["classes", "", 7.5]]; // map, words, width in digits

function Numbers() {
  const [sides, pixel] = useStore((s) => [shownSides(s), s.view.pixel ?? s.hover, photo(), observedDepth()]);
  const colour = pixel && colourAt(pixel);
  const depth = pixel && depthAt(pixel);
  const maps = OF_PIXEL.filter(([name]) => name !== "correlation" || hasColour(sides));
  const adds = (side) =>
    `½ (f_d + f_n); its mean over the ${side.score?.n ?? 0} pixels that count is the score without colour`;
  const isMarked = useStore((s) => s.view.pixel != null);
  if (!pixel) return html`<div class="pixel-numbers"><div class="none">Numbers of a pixel: point at it, click to mark it</div></div>`;
  // Over the picture, which keeps its place.
  return html`<div class="pixel-numbers"><div class=${`rows ${isMarked ? "" : "passing"}`}>
    <div><b class="at">${pixel.join(", ")}</b>
      <span>observed <i>${depth ? `${depth.toFixed(4)} m` : "–"}</i></span>
      ${state.frame.rgb && html`<span>colour <i>${colour
        ? html`<em style=${{ background: `rgb(${colour})` }} />${colour.join(" ")}` : "–"}</i></span>`}</div>
    ${[sides.a, sides.b].filter(Boolean).map((side) => html`<div key=${side.letter}>
      <b class=${`letter ${side.letter}`}>${side.letter.toUpperCase()}</b>
      ${maps.map(([name, words, width]) => html`<span class=${name} title=${MAPS[name].hint}>${words} <i
        style=${{ minWidth: `${width}ch` }}>${numberOf(name, side, pixel)}</i></span>`)}
      <span class="adds" title=${adds(side)}>adds <i>${fitOf(side, pixel)}</i></span></div>`)}
  </div></div>`;
}
function numberOf(name, side, pixel) {
  if (side.stale) return side.gone ? "–" : "…";
  const value = readAt(name, side, pixel);
  if (value == null) return "–";
  if (name !== "classes") return `${valueText(MAPS[name], value)}${name === "angle" ? "°" : ""}`;
  return html`<em style=${{ background: palette.classes.find((c) => c.name === value).color }} />${value}`;
}
function fitOf(side, pixel) {
  const [f_d, f_n] = ["f_d", "f_n"].map((name) =>
    /** @type {number | null} */ (side.stale ? null : readAt(name, side, pixel)));
  return f_d == null ? "–" : ((f_d + f_n) / 2).toFixed(2);
}

// Mouse

export const setHover = (pixel) => String(pixel) === String(state.hover ?? null) || update({ hover: pixel });
export function inImage(u, v) {
  const { w, h } = state.frame.camera;
  const pixel = [Math.floor(u), Math.floor(v)];
  return pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] < w && pixel[1] < h ? /** @type {[number, number]} */ (pixel) : null;
}

// Whether a point of the image lies on the label in hand, so that a drag there moves it.
function isOnLabel(u, v) {
  const label = labelInHand(state);
  const path = label && outlineOf(label.obj, label.T);
  return Boolean(path && document.createElement("canvas").getContext("2d").isPointInPath(path, u, v));
}
const clamped = ({ u, v }) => {
  const { w, h } = state.frame.camera;
  return /** @type {[number, number]} */ ([Math.min(Math.max(Math.floor(u), 0), w - 1), Math.min(Math.max(Math.floor(v), 0), h - 1)]);
};

// The kind of a drag that begins at a point, off the divider.
function kindOf(event, { u, v, pixel }) {
  if (modelInHand(state) && pixel) return "sketch";
  if (!state.view.edited && !isOnLabel(u, v)) return event.shiftKey ? "ruler" : "pan";
  return event.shiftKey ? "turn" : event.ctrlKey || event.altKey ? "spin" : "move";
}

// The action of each kind of drag at each move.
const dragsOf = (here, setPlace) => ({
  wipe: ({ now }) => setLayers({ at: Math.min(Math.max(now.x / here.current.size.w, 0), 1) }),
  sketch: ({ now }) => update({ sketch: sketchedTo(state.sketch, clamped(now)) }),
  pan: ({ place, dx, dy }) => setPlace({ scale: place.scale, x: place.x + dx, y: place.y + dy }),
  ruler: ({ start, now }) => setView({ ruler: start.pixel && now.pixel ? [start.pixel, now.pixel] : null }),
  move: ({ T, place, dx, dy }) => moveTo(dragged(T, dx / place.scale, dy / place.scale, state.frame.camera.K), "drag"),
  turn: ({ T, dx, dy }) => moveTo(turnedBy(T, dx * TURN, dy * TURN), "drag"),
  spin: ({ T, start, now }) => {
    const [u, v] = project(origin(T), state.frame.camera.K);
    const angle = (p) => Math.atan2(p.v - v - 0.5, p.u - u - 0.5);
    moveTo(turned(T, origin(T), angle(now) - angle(start)), "drag");
  },
});

// `here.current` holds the pane's size, the image's place in it, and the current drag.
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
  const drags = dragsOf(here, setPlace);

  const onPointerDown = (event) => {
    if (event.button !== 0) return;
    const start = at(event);
    const { place } = here.current;
    const kind = overDivider(start.x) ? "wipe" : kindOf(event, start);
    if (kind === "sketch" && state.placing) return;
    if (kind === "sketch") update({ sketch: sketchAt(start.pixel, event.altKey || state.view.scribbles) });
    here.current.drag = { kind, start, place, T: state.view.edited?.T ?? labelInHand(state)?.T, far: false };
    canvas.current.setPointerCapture(event.pointerId);
  };
  const onPointerMove = (event) => {
    const now = at(event);
    const { drag } = here.current;
    setHover(now.pixel);
    const isWipe = drag ? drag.kind === "wipe" : overDivider(now.x);
    canvas.current.style.cursor = isWipe ? "ew-resize" : modelInHand(state) ? "copy"
      : state.view.edited || drag?.kind === "move" || (!drag && isOnLabel(now.u, now.v)) ? "move" : "crosshair";
    if (!drag) return;
    const [dx, dy] = [now.x - drag.start.x, now.y - drag.start.y];
    const wasFar = drag.far;
    drag.far ||= Math.hypot(dx, dy) > FAR_PX;
    if (drag.far && !wasFar && !state.view.edited && ["move", "turn", "spin"].includes(drag.kind)) edit();
    if (drag.far || drag.kind === "wipe") drags[drag.kind]({ ...drag, now, dx, dy });
  };
  const onPointerUp = () => {
    const { drag } = here.current;
    here.current.drag = null;
    if (drag?.kind === "sketch" && state.sketch) return ask(state.sketch);
    if (!drag || drag.far || drag.kind === "wipe" || state.view.edited) return undefined;
    if (drag.start.pixel) mark(drag.start.pixel);
    return undefined;
  };
  const onWheel = (event) => {
    event.preventDefault();
    if (state.view.edited && !event.ctrlKey) {
      const mm = Math.sign(event.deltaY || event.deltaX) * NOTCH_MM * (event.shiftKey ? FINE : 1);
      return moveTo(receded(state.view.edited.T, -mm / 1000), "wheel");
    }
    const { place, size } = here.current;
    const fit = Math.min(size.w / state.frame.camera.w, size.h / state.frame.camera.h);
    return setPlace(zoomed(place, Math.exp(-0.0016 * event.deltaY), at(event), 0.5 * fit, 60 * fit));
  };
  const onDblClick = () => {
    if (modelInHand(state)) return;
    setView({ pixel: null });
    fitNext();
  };
  const onPointerCancel = () => {
    here.current.drag = null;
    update({ sketch: null });
  };
  const onPointerLeave = () => here.current.drag || setHover(null);
  return { onPointerDown, onPointerMove, onPointerUp, onPointerCancel, onPointerLeave, onWheel, onDblClick };
}

// Keys

function toggleOutline(key) {
  if (isChosenBySense(key)) return toggleDrawn(momentOf(state), key);
  const { hidden } = layersOf(state);
  return setLayers({ hidden: hidden.includes(key) ? hidden.filter((k) => k !== key) : [...hidden, key] });
}
const blink = () => layersOf(state).blink == null && setLayers({ blink: nextBlink("photo") });
// After the photo A, after A B where it is another pose, then the photo again.
/** @type {(now: "photo" | "a" | "b") => "photo" | "a" | "b"} */
function nextBlink(now) {
  const { a, b } = shownSides(state);
  const all = /** @type {("photo" | "a" | "b")[]} */ (["photo", ...(a ? ["a"] : []), ...(b ? ["b"] : [])]);
  return all[(all.indexOf(now) + 1) % all.length];
}
const KEYS = [
  { id: "edit", keys: ["p"], title: "Edit the pose in the image", group: "Image", action: toggleEdit,
    when: () => !state.file },
  { id: "blink", keys: ["v"], title: "Hold: photo, A and B in turn", group: "Image", action: blink },
  { id: "hypotheses", keys: ["h"], title: "Outlines of the hypotheses on or off", group: "Image",
    action: () => toggleOutline("hypotheses") },
  { id: "truth", keys: ["u"], title: "Outline of the ground truth on or off", group: "Image",
    action: () => toggleOutline("ground truth"), when: () => Boolean(momentOf(state)?.object.gt) },
  { id: "fit", keys: ["o"], title: "Fit the object, or the whole image", group: "Image", action: fitNext },
];
function useKeys() {
  const blinks = useStore((s) => layersOf(s).blink != null);
  useEffect(() => addKeys(KEYS), []);
  useEditKeys();
  useEffect(() => {
    if (!blinks) return undefined;
    const timer = setInterval(() => setLayers({ blink: nextBlink(layersOf(state).blink) }), BLINK_MS);
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
  const root = useRef(null);
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
  const [doubted, edits] = useStore((s) => [Boolean(shownDoubt(s)), Boolean(s.view.edited)]);
  const canvas = useRef(null);
  const here = useRef({});
  const paint = useRef(null);
  paint.current = () => {
    const moment = momentOf(state);
    if (!size || !canvas.current) return;
    const place = placeOf(state.view.zoom ?? null, size, state.frame.camera, moment?.object.box);
    Object.assign(here.current, { size, place });
    fitCanvas(canvas.current, size);
    draw(canvas.current, size, place, moment, sidesOf(moment), layersOf(state));
    prepareAhead();
  };
  // Drawn at most once per animation frame, however much changes: the store sees to that.
  useEffect(() => listen(() => paint.current()), []);
  useLayoutEffect(() => paint.current(), [size]);
  useKeys();
  return html`<div class="picture">
    <div class="stage" ref=${root} onPointerEnter=${() => update({ hoverIn: "image" })}
      onPointerLeave=${() => update({ hoverIn: null })}>
      <canvas ref=${canvas} ...${handlers(canvas, here)} />
      <${Legend} /><${Acts} /><${WipeNames} /><${Placing} />
    </div>
    ${edits ? html`<${EditBar} />` : doubted ? html`<${DoubtCard} />` : html`<${Numbers} />`}
  </div>`;
}

// Buttons that lie over the image.
function Acts() {
  const [zoom, edits, layers] = useStore((s) => [s.view.zoom, Boolean(s.view.edited), s.view.layers]);
  const { under, blink: blinks } = { ...DEFAULTS, ...layers };
  const isThere = useStore((s) => Boolean(momentOf(s)));
  return html`<div class="acts">
    ${state.frame.rgb && html`<${Button} title="observed depth instead of the photo" on=${under === "depth"}
      onClick=${() => setLayers({ under: under === "depth" ? "photo" : "depth" })}>Depth<//>`}
    ${isThere && html`<${Button} title="photo, A and B in turn (hold V)" on=${blinks != null}
      onClick=${() => (blinks == null ? blink() : setLayers({ blink: null }))}>Blink<//>`}
    ${(isThere || typeof zoom === "object" && zoom) && html`<${Button} title="fit the object, or the whole image (O, or double click)" onClick=${fitNext}>
      ${zoom == null ? "Whole" : isThere ? "Object" : "Fit"}<//>`}
    ${isThere && html`<${Button} engine title="move the pose by the mouse (P)" on=${edits} onClick=${toggleEdit}>Edit pose<//>`}</div>`;
}

// The action of a press while a model is chosen.
function Placing() {
  const [model, scribbles, placing] = useStore((s) => [modelInHand(s), s.view.scribbles, s.placing]);
  if (!model) return null;
  return html`<div class="placing"><b>${model.name}</b>
    <span>${placing ? "is placed …" : `click: place it. Drag: find it ${scribbles ? "on a scribble" : "in a box"}.`}</span>
    <${Button} title="drag a scribble over the object instead of a box (or hold Alt)" on=${scribbles}
      onClick=${() => setView({ scribbles: !scribbles })}>Scribble<//>
    <${Button} title="place nothing (Esc)" icon="close" kind="square" onClick=${() => setView({ model: null })} /></div>`;
}

function Legend() {
  const [moment, doubt] = useStore((s) => [momentOf(s), shownDoubt(s), s.view.layers]);
  if (!moment || doubt) return null;
  const layers = layersOf(state);
  const entry = ({ key, color, dashed, label, hint, letter }) => html`
    <button type="button" key=${key} class=${isOutlined(moment, layers, key) ? "" : "off"} title=${hint ? `${hint}; show or hide` : "show or hide"}
      onClick=${(e) => { e.currentTarget.blur(); toggleOutline(key); }}>
      <${Swatch} color=${color} hollow=${dashed} /><span>${label}</span>
      ${letter && html`<b class=${`letter ${letter.toLowerCase()}`}>${letter}</b>`}</button>`;
  return html`<div class="legend">${contoursOf(moment).map(entry)}</div>`;
}

function WipeNames() {
  const [layers, moment] = useStore((s) => [s.view.layers, momentOf(s)]);
  const { wipe, over, at, under, blink: blinks } = layersOf(state);
  if (blinks && layers) {
    const shown = blinks === "photo" ? (state.frame.rgb ? under : "depth") : `${blinks.toUpperCase()} ${moment?.[blinks]?.label ?? ""}`;
    return html`<div class="wiped"><span class="blinks">${shown}</span></div>`;
  }
  if (wipe === "off") return null;
  const model = MAPS[over]?.label ?? "shaded model";
  const names = wipe === "ab" ? [`A ${model}`, `B ${model}`] : [state.frame.rgb ? under : "depth", model];
  const left = `${100 * at}%`;
  return html`<div class="wiped">${names.map((name) => html`<span style=${{ left }}>${name}</span>`)}</div>`;
}
