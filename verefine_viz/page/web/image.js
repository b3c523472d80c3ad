// The image pane: photo or depth, a map or the shaded model over it, outlines of poses; wiped, blinked, measured; and a
// pose that is moved by the mouse.
import { html, useEffect, useLayoutEffect, useRef, useState } from "./vendor/htm-preact.js";
import { state, setView, update, send, listen, useStore } from "./store.js";
import { momentOf } from "./moment.js";
import { Pane, Button, Select, Swatch } from "./ui.js";
import { ACTIONS } from "./keys.js";
import { MAPS, CLASSES, valueText } from "./colours.js";
import { sidesOf, readAt, photo, colourAt, observedDepth, hasColour, prepareAhead } from "./sides.js";
import { contoursOf, depthAt, draw } from "./drawing.js";
import { between, dragged, origin, project, receded, shifted, turned } from "./pose.js";

const MARGIN = 0.25; // shown around the object, as a share of its size
const NEAR_PX = 7; // a click that moved less is no drag; how near the divider is taken
const TURN = 0.4; // degrees a pixel of a drag
const NOTCH_MM = 1;
const BLINK_MS = 450;
const DEFAULTS = { under: "photo", over: "none", side: "b", opacity: 0.75, wipe: "off", at: 0.5, blink: null,
  hidden: ["hypotheses", "mask"] };
const layersOf = (s) => ({ ...DEFAULTS, ...s.view.layers });
const setLayers = (patch) => setView({ layers: { ...layersOf(state), ...patch } });

// Where the image is in the canvas: a scale [px of the canvas a pixel] and the place of pixel 0, 0.

function placeOf(zoom, size, camera, box) {
  if (zoom && zoom !== "image") {
    const scale = zoom.share * Math.min(size.w / camera.w, size.h / camera.h);
    return { scale, x: size.w / 2 - zoom.u * scale, y: size.h / 2 - zoom.v * scale };
  }
  const [u0, v0, u1, v1] = zoom === "image" || !box ? [0, 0, camera.w, camera.h] : box;
  const around = zoom === "image" || !box ? 0 : MARGIN;
  const [w, h] = [(u1 - u0) * (1 + 2 * around), (v1 - v0) * (1 + 2 * around)];
  const scale = Math.max(Math.min(size.w / w, size.h / h), Math.min(size.w / camera.w, size.h / camera.h));
  // The middle of the box in the middle; but nothing beside the image where there is enough of it.
  const start = (whole, room, middle) =>
    scale * whole > room ? Math.min(Math.max(room / 2 - scale * middle, room - scale * whole), 0) : (room - scale * whole) / 2;
  return { scale, x: start(camera.w, size.w, (u0 + u1) / 2), y: start(camera.h, size.h, (v0 + v1) / 2) };
}
const zoomOf = (place, size, camera) => ({
  share: place.scale / Math.min(size.w / camera.w, size.h / camera.h),
  u: (size.w / 2 - place.x) / place.scale,
  v: (size.h / 2 - place.y) / place.scale,
});
function zoomed(place, factor, x, y, size, camera) {
  const fit = Math.min(size.w / camera.w, size.h / camera.h);
  const scale = Math.min(Math.max(place.scale * factor, 0.5 * fit), 60 * fit);
  const by = scale / place.scale;
  return { scale, x: x - (x - place.x) * by, y: y - (y - place.y) * by };
}

// Numbers of a pixel, straight from the arrays

const OF_PIXEL = [["rendered", "model", 6.2], ["difference", "Δ mm", 5], ["angle", "∠", 2.6], ["f_d", "f_d", 3], ["f_n", "f_n", 3], ["correlation", "corr.", 4.2], ["classes", "", 7.5]];
function Numbers() {
  const [sides, pixel] = useStore((s) => [sidesOf(momentOf(s)), s.hover ?? s.view.pixel, photo(), observedDepth()]);
  const colour = pixel && colourAt(pixel);
  const depth = pixel && depthAt(pixel);
  return html`<div class="pixel-numbers">
    <div><b class="at">${pixel ? `${pixel[0]}, ${pixel[1]}` : "pixel"}</b><span>observed <i>${depth ? `${depth.toFixed(4)} m` : "–"}</i></span>
      ${state.frame.rgb && html`<span>colour <i>${colour ? html`<em style=${{ background: `rgb(${colour})` }} />${colour.join(" ")}` : "–"}</i></span>`}</div>
    ${[sides.a, sides.b].filter(Boolean).map((side) => html`<div key=${side.letter}><b class=${`letter ${side.letter}`}>${side.letter.toUpperCase()}</b>
      ${OF_PIXEL.filter(([name]) => name !== "correlation" || hasColour(sides)).map(([name, words, width]) => html`
        <span class=${name} title=${MAPS[name].hint}>${words} <i style=${{ minWidth: `${width}ch` }}>${numberOf(name, side, pixel)}</i></span>`)}
      <span class="adds" title=${`½ (f_d + f_n); their mean over the ${side.score?.n ?? 0} pixels that count is the score without colour`}>adds <i>${fitOf(side, pixel)}</i></span></div>`)}
  </div>`;
}
function numberOf(name, side, pixel) {
  if (side.stale) return "…";
  const value = readAt(name, side, pixel);
  if (value == null) return "–";
  if (name === "classes") return html`<em style=${{ background: CLASSES.find((c) => c.name === value).color }} />${value}`;
  return `${valueText(MAPS[name], value)}${name === "angle" ? "°" : ""}`;
}
function fitOf(side, pixel) {
  const [f_d, f_n] = ["f_d", "f_n"].map((name) => (side.stale ? null : readAt(name, side, pixel)));
  return f_d == null ? "–" : ((f_d + f_n) / 2).toFixed(2);
}

// Editing a pose

const editable = (moment) => moment.poses.accepted ?? moment.poses.current ?? moment.poses.best ?? moment.poses.initial;
export function toggleEdit() {
  if (state.view.edited) return setView({ edited: null });
  const moment = momentOf(state);
  const pose = moment && editable(moment);
  if (!pose?.T) return undefined;
  return setView({ edited: { obj: moment.obj, arm: pose.arm ?? moment.arm, T: pose.T, from: pose.T } });
}
const moveTo = (T) => setView({ edited: { from: editable(momentOf(state)).T, ...state.view.edited, T } });
function nudge(x, y) {
  const mm = window.event?.shiftKey ? 0.2 * NOTCH_MM : NOTCH_MM;
  moveTo(shifted(state.view.edited.T, [(x * mm) / 1000, (y * mm) / 1000, 0]));
}
function proceed(moment) {
  const { obj, arm, T } = state.view.edited;
  if (send({ verb: "fork", branch: moment.branch, k: moment.k, changes: {}, edit: { obj, arm, T } })) setView({ edited: null });
}

function EditLine() {
  const [moment, sides, edit] = useStore((s) => [momentOf(s), sidesOf(momentOf(s)), s.view.edited]);
  if (!edit) return null;
  const { T, from = editable(moment).T } = edit;
  const { mm, deg } = between(from, T);
  const now = sides.b?.pose.name === "edited" ? sides.b : sides.a;
  const before = editable(moment)?.score;
  const score = now?.pose?.name === "edited" && !now.stale ? now.score.score : null;
  return html`<div class="editing">
    <span>hypothesis ${edit.arm + 1} moved <b>${mm.toFixed(1)} mm</b> <b>${deg.toFixed(1)}°</b></span>
    <span>score <b>${score == null ? "…" : score.toFixed(3)}</b>${before != null && html` <i>from ${before.toFixed(3)}</i>`}</span>
    <${Button} kind="primary" title="a new branch from this pose" onClick=${() => proceed(moment)}>Continue from here<//>
    <${Button} title="where it began" disabled=${mm + deg === 0} onClick=${() => moveTo(from)}>Reset<//>
    <${Button} title="stop editing (Esc)" onClick=${() => setView({ edited: null })}>Cancel<//>
    <i class="how">drag: move, wheel: depth, Shift: turn, Ctrl: turn in the image, arrows: 1 mm (Shift 0.2)</i>
  </div>`;
}

// Mouse

function pointer(event, canvas, here) {
  const box = canvas.getBoundingClientRect();
  const [x, y] = [event.clientX - box.left, event.clientY - box.top];
  const { place } = here.current;
  return { x, y, u: (x - place.x) / place.scale, v: (y - place.y) / place.scale };
}
function pixelOf({ u, v }) {
  const { w, h } = state.frame.camera;
  const pixel = [Math.floor(u), Math.floor(v)];
  return pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] < w && pixel[1] < h ? pixel : null;
}
export const setHover = (pixel) => String(pixel) === String(state.hover ?? null) || update({ hover: pixel });
export const markPixel = (pixel) => setView({ pixel: String(pixel) === String(state.view.pixel) ? null : pixel });

function handlers(root, here) {
  const setZoom = (place) => setView({ zoom: zoomOf(place, here.current.size, state.frame.camera) });
  const down = (event) => {
    if (event.button !== 0) return;
    const start = pointer(event, root.current, here);
    const layers = layersOf(state);
    const wipes = layers.wipe !== "off" && Math.abs(start.x - layers.at * here.current.size.w) < NEAR_PX;
    const T = state.view.edited?.T;
    const kind = wipes ? "wipe" : T ? (event.shiftKey ? "turn" : event.ctrlKey || event.altKey ? "spin" : "move") : event.shiftKey ? "ruler" : "pan";
    here.current.drag = { kind, start, T, place: here.current.place, far: false };
    root.current.setPointerCapture(event.pointerId);
  };
  const move = (event) => {
    const now = pointer(event, root.current, here);
    const { drag, size } = here.current;
    const { K } = state.frame.camera;
    setHover(pixelOf(now));
    const layers = layersOf(state);
    const overDivider = layers.wipe !== "off" && Math.abs(now.x - layers.at * size.w) < NEAR_PX;
    root.current.style.cursor = drag?.kind === "wipe" || overDivider ? "ew-resize" : state.view.edited ? "move" : "crosshair";
    if (!drag) return;
    const [dx, dy] = [now.x - drag.start.x, now.y - drag.start.y];
    drag.far ||= Math.hypot(dx, dy) > 3;
    if (!drag.far && drag.kind !== "wipe") return;
    if (drag.kind === "wipe") setLayers({ at: Math.min(Math.max(now.x / size.w, 0), 1) });
    else if (drag.kind === "pan") setZoom({ scale: drag.place.scale, x: drag.place.x + dx, y: drag.place.y + dy });
    else if (drag.kind === "ruler") setView({ ruler: [pixelOf(drag.start), pixelOf(now)].every(Boolean) ? [pixelOf(drag.start), pixelOf(now)] : null });
    else if (drag.kind === "move") moveTo(dragged(drag.T, dx / drag.place.scale, dy / drag.place.scale, K));
    else if (drag.kind === "turn") moveTo(turned(turned(drag.T, [0, -1, 0], (dx * TURN * Math.PI) / 180), [1, 0, 0], (dy * TURN * Math.PI) / 180));
    else if (drag.kind === "spin") {
      const [u, v] = project(origin(drag.T), K);
      const angle = (p) => Math.atan2(p.v - v - 0.5, p.u - u - 0.5);
      moveTo(turned(drag.T, origin(drag.T), angle(now) - angle(drag.start)));
    }
  };
  const up = () => {
    const { drag } = here.current;
    here.current.drag = null;
    if (!drag || drag.far || !["pan", "ruler"].includes(drag.kind)) return;
    if (state.view.ruler) setView({ ruler: null });
    const pixel = pixelOf(drag.start);
    if (pixel) markPixel(pixel);
  };
  const wheel = (event) => {
    event.preventDefault();
    const { x, y } = pointer(event, root.current, here);
    const { place, size } = here.current;
    if (state.view.edited && !event.ctrlKey) {
      const mm = Math.sign(event.deltaY || event.deltaX) * NOTCH_MM * (event.shiftKey ? 0.2 : 1);
      return moveTo(receded(state.view.edited.T, -mm / 1000));
    }
    return setZoom(zoomed(place, Math.exp(-0.0016 * event.deltaY), x, y, size, state.frame.camera));
  };
  return { onPointerDown: down, onPointerMove: move, onPointerUp: up, onPointerCancel: () => (here.current.drag = null),
    onPointerLeave: () => here.current.drag || setHover(null), onWheel: wheel };
}

export const IMAGE_KEYS = [
  { id: "edit", keys: ["p"], title: "Edit the pose in the image", group: "Image", action: toggleEdit },
  { id: "blink", keys: ["v"], title: "Hold: photo and shaded model in turn", group: "Image", action: () => layersOf(state).blink == null && setLayers({ blink: true }) },
  { id: "fit", keys: ["o"], title: "Fit the object, or the whole image", group: "Image", action: () => fitNext() },
];
const ARROWS = [["ArrowLeft", -1, 0], ["ArrowRight", 1, 0], ["ArrowUp", 0, -1], ["ArrowDown", 0, 1]].map(([key, x, y]) =>
  ({ id: `nudge ${key}`, keys: [key], title: "Move the edited pose by 1 mm", group: "Image", action: () => nudge(x, y), silent: true }));
// Keys of a pane go before those of the page; returns what takes them away again.
function takeKeys(actions) {
  ACTIONS.unshift(...actions);
  return () => actions.forEach((a) => ACTIONS.includes(a) && ACTIONS.splice(ACTIONS.indexOf(a), 1));
}

// Size of an element in CSS pixels, and of a rem.
export function useSize() {
  const root = useRef();
  const [size, setSize] = useState(null);
  useLayoutEffect(() => {
    const measure = () => {
      const { width, height } = root.current.getBoundingClientRect();
      const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
      setSize((before) => (before?.w === width && before.h === height && before.rem === rem ? before : { w: width, h: height, rem }));
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
  useStore((s) => s.frame);
  return html`<${Pane} name="image" title="Image" tools=${html`<${Tools} />`}>${state.frame ? html`<${Picture} />` : ""}<//>`;
}

function Tools() {
  const [moment, sides] = useStore((s) => [momentOf(s), sidesOf(momentOf(s)), s.view.layers, s.view.edited, s.view.zoom]);
  if (!moment) return null;
  const layers = layersOf(state);
  const maps = Object.keys(MAPS).filter((name) => name !== "observed" && (!MAPS[name].colour || hasColour(sides)) && (name !== "gain" || sides.b));
  return html`
    <${Select} title="what is laid over the picture" value=${layers.over} onChange=${(over) => setLayers({ over })}
      options=${[["none", "nothing over it"], ["shaded", "shaded model"], ...maps.map((name) => [name, MAPS[name].label])]} />
    ${sides.b && html`<${Button} kind="square" title=${`the pose that is laid over it: ${layers.side.toUpperCase()}; click for the other`}
      onClick=${() => setLayers({ side: layers.side === "a" ? "b" : "a" })}><b class=${`letter ${layers.side}`}>${layers.side.toUpperCase()}</b><//>`}
    <input type="range" class="opacity" min="0" max="1" step="0.05" value=${layers.opacity} title="opacity of what is laid over the picture"
      onInput=${(e) => setLayers({ opacity: +e.currentTarget.value })} onChange=${(e) => e.currentTarget.blur()} />
    <${Select} title="wipe: a divider to drag" value=${layers.wipe} onChange=${(wipe) => setLayers({ wipe })}
      options=${[["off", "no wipe"], ["photo", `${state.frame.rgb ? "photo" : "depth"} | model`], ...(sides.b ? [["ab", "A | B"]] : [])]} />`;
}

// Buttons that lie over the image.
function Acts() {
  const [zoom, edits, blinks] = useStore((s) => [s.view.zoom, Boolean(s.view.edited), layersOf(s).blink != null]);
  const depth = useStore((s) => layersOf(s).under === "depth");
  return html`<div class="acts">
    ${state.frame.rgb && html`<${Button} title="observed depth instead of the photo" on=${depth} onClick=${() => setLayers({ under: depth ? "photo" : "depth" })}>Depth<//>`}
    <${Button} title="photo and shaded model in turn (hold V)" on=${blinks}
      onClick=${() => setLayers({ blink: blinks ? null : true })}>Blink<//>
    <${Button} title="fit the object, or the whole image (O, or double click)" onClick=${fitNext}>
      ${zoom == null ? "Whole" : "Object"}<//>
    <${Button} title="move the pose by the mouse (P)" on=${edits} onClick=${toggleEdit}>Edit pose<//></div>`;
}
const fitNext = () => setView({ zoom: state.view.zoom == null ? "image" : null });

function Picture() {
  const [root, size] = useSize();
  const canvas = useRef();
  const here = useRef({}); // size, place and drag
  const paint = useRef();
  paint.current = () => {
    const moment = momentOf(state);
    if (!size || !moment || !canvas.current) return;
    const { camera } = state.frame;
    Object.assign(here.current, { size, place: placeOf(state.view.zoom ?? null, size, camera, moment.object.box) });
    fitCanvas(canvas.current, size);
    draw(canvas.current, size, here.current.place, moment, sidesOf(moment), layersOf(state));
    prepareAhead();
  };
  // Whatever changes, it draws at most once per animation frame: the store takes care of that.
  useEffect(() => listen(() => paint.current()), []);
  useLayoutEffect(() => paint.current(), [size]);
  useEffect(() => takeKeys(IMAGE_KEYS), []);
  useEffect(() => {
    const letGo = (e) => e.key.toLowerCase() === "v" && layersOf(state).blink != null && setLayers({ blink: null });
    addEventListener("keyup", letGo);
    return () => removeEventListener("keyup", letGo);
  }, []);
  const [edits, blinks, isOver] = useStore((s) => [Boolean(s.view.edited), layersOf(s).blink != null, s.hoverIn === "image"]);
  useEffect(() => (edits && isOver ? takeKeys(ARROWS) : undefined), [edits, isOver]);
  useEffect(() => {
    if (!blinks) return undefined;
    const timer = setInterval(() => setLayers({ blink: !layersOf(state).blink }), BLINK_MS);
    return () => clearInterval(timer);
  }, [blinks]);
  return html`<div class="picture">
    <div class="stage" ref=${root} onPointerEnter=${() => update({ hoverIn: "image" })} onPointerLeave=${() => update({ hoverIn: null })}>
      <canvas ref=${canvas} ...${handlers(canvas, here)} onDblClick=${() => { setView({ pixel: null }); fitNext(); }} />
      <${Legend} /><${Acts} /><${WipeNames} />${edits && html`<${EditLine} />`}
    </div>
    <${Numbers} />
  </div>`;
}

function Legend() {
  const [moment, sides] = useStore((s) => [momentOf(s), sidesOf(momentOf(s)), s.view.layers]);
  if (!moment) return null;
  const { hidden } = layersOf(state);
  const toggle = (key) => setLayers({ hidden: hidden.includes(key) ? hidden.filter((k) => k !== key) : [...hidden, key] });
  return html`<div class="legend">${contoursOf(moment, sides).map((one) => html`
    <button type="button" key=${one.key} class=${hidden.includes(one.key) ? "off" : ""} title="show or hide this outline"
      onClick=${(e) => { e.currentTarget.blur(); toggle(one.key); }}>
      <${Swatch} color=${one.color} hollow=${one.dashed} />${one.label}</button>`)}</div>`;
}

function WipeNames() {
  const layers = useStore((s) => (layersOf(s).wipe === "off" ? null : s.view.layers));
  if (!layers) return null;
  const { wipe, over, at } = layersOf(state);
  const model = MAPS[over]?.label ?? "shaded model";
  const names = wipe === "ab" ? [`A ${model}`, `B ${model}`] : [state.frame.rgb && layersOf(state).under === "photo" ? "photo" : "depth", model];
  return html`<div class="wiped">${names.map((name) => html`<span style=${{ left: `${100 * at}%` }}>${name}</span>`)}</div>`;
}
