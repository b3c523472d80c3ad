// The 3D pane: viser's page in a frame, and the page's own bar, legend and numbers over it. It follows the window used last.
import { html } from "htm/preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { state, send, useStore } from "./store.js";
import { addKeys, attachKeys, titled } from "./keys.js";
import { lookAt } from "./wants.js";
import { isLabelled, momentOf } from "./moment.js";
import { photo, sidesOf } from "./sides.js";
import { isFile, scenePage } from "./file.js";
import { Marked, toggleMeasuring } from "./marking.js";
import { isLayerShown, layersAtEnd, layersOf, sceneOf, setScene, showLayer, toggleLayer, toleranceOf, WHOLE } from "./scene_layers.js";
import { guardGizmo } from "./gizmo_guard.js";
import { gradient } from "./colours.js";
import { palette } from "./palette.js";
import { Button, Menu, Pane, Select, Swatch, Toggle } from "./ui.js";

const LATEST_MS = 3000;
const LOOK_MS = 200;

// After some slow pictures viser would reduce its resolution, and rarely restore it.
const ADDRESS = `/3d/?darkMode&fixedDpr=${devicePixelRatio}`;
const CAMERAS = [
  { id: "object", key: "c", name: "Object", title: "3D: camera to the object in focus, where it is not hidden" },
  { id: "sensor", key: "C", name: "Sensor", title: "3D: camera to where the sensor was" },
  { id: "first", key: "x", name: "First", title: "3D: camera back to the first view" },
];
const CLOUDS = [["photo"], ["distance to model", "distance"], ["normals"], ["class", "classes"]];

function look(camera = null) {
  if (camera === "sensor") showLayer("photo", false); // from there it would hide everything else
  const verb = lookAt(state, momentOf(state));
  if (verb) send({ ...verb, camera });
}
addKeys(CAMERAS.map(({ id, key, title }) => ({ id: `camera-${id}`, keys: [key], title, group: "Show", action: () => look(id) })));
addKeys([{ id: "measure", keys: ["m"], title: "Measure: a point, or the distance of two", group: "Show", action: toggleMeasuring,
  when: () => !state.file }]);

// Whether this browser can draw in 3D here.
const hasWebGL = Boolean(document.createElement("canvas").getContext("webgl2"));

export function ScenePane() {
  if (!hasWebGL) return html`<${Pane} name="scene" title="3D"><p class="empty">3D needs WebGL 2, which this browser does not have here. All else works.</p><//>`;
  return html`<${Viser} />`;
}

function Viser() {
  const frame = useRef(null);
  const [page, begun] = useScenePage();
  const [veil, restart] = useVeil(frame);
  const [window, follows] = useStore((s) => [s.window, s.scene3d]);
  useGround(frame, veil);
  useFirstLook(frame, veil);
  const loaded = () => {
    restart();
    if (!begun) return;
    attachKeys(frame.current.contentWindow);
    guardGizmo(frame.current.contentWindow, () => sceneOf(state).gizmo);
  };
  const elsewhere = follows != null && window != null && follows !== window;
  if (isFile && page === null) return html`<${Pane} name="scene" title="3D"><p class="empty">The file holds no 3D view.</p><//>`;
  const title = isFile ? "3D at the end" : "3D";
  return html`<${Pane} name="scene" title=${title} tools=${isFile ? html`<span class="spring" />` : html`<${Tools} />`}>
    <iframe ref=${frame} ...${isFile ? { srcdoc: page } : { src: begun ? ADDRESS : undefined }} title="3D view" onLoad=${loaded} />
    <${Legend} />
    ${!isFile && html`<div class="notes"><${ColourBar} /><${Marked} /></div>`}
    ${veil && html`<div class="loading">${veil}</div>`}
    ${elsewhere && html`<button type="button" class="elsewhere" title="let the 3D view follow this window" onClick=${() => look()}>3D follows another window: show this one</button>`}
  <//>`;
}

// viser's page in a frame. Loaded after the first maps, as it keeps the processor busy for a second or two.
function useScenePage() {
  const pictured = useStore((s) => Boolean(momentOf(s) ? sidesOf(momentOf(s)).a?.arrays : photo()));
  const [begun, begin] = useState(false);
  useEffect(() => {
    if (pictured) begin(true);
    const late = setTimeout(() => begin(true), LATEST_MS);
    return () => clearTimeout(late);
  }, [pictured]);
  const [page, setPage] = useState(undefined); // the 3D view in a file; null = it has none
  useEffect(() => {
    if (isFile && begun) scenePage().then(setPage);
  }, [begun]);
  return [page, begun];
}

/**
 * Why the frame does not show the page's state, "" = it does; and a function that begins again when it is reloaded.
 * @returns {[string, () => void]}
 */
function useVeil(frame) {
  const [seen, see] = useState({ drawn: false, id: null });
  const [id, connection, isThere, name] = useStore((s) =>
    [s.frame?.id, s.connection, Boolean(s.frame), isLabelled(s.frame) ? s.frame.frame : s.frame?.id]);
  // After a step on labels, the view from before the step is good enough.
  const first = useRef({ name: null, id: null });
  if (first.current.name !== name) first.current = { name, id };
  const isCurrent = seen.drawn && (isFile || !isThere || (seen.id >= first.current.id && seen.id <= id));
  useEffect(() => {
    if (isCurrent) return undefined;
    const check = () => see({ drawn: hasDrawn(frame.current?.contentWindow), id: shownFrame(frame.current?.contentWindow) });
    const waiting = setInterval(check, LOOK_MS);
    return () => clearInterval(waiting);
  }, [isCurrent, id]);
  const restart = () => see({ drawn: false, id: null });
  const words = connection === "lost" ? "The server does not answer."
    : !seen.drawn ? "Loading the 3D view" : "The 3D view still shows another frame";
  return [isCurrent ? "" : words, restart];
}

// Whether viser has drawn a picture; if it does not count them, whether it has a canvas.
function hasDrawn(viser) {
  const frames = viser?.__viserTestpoints?.rendererInfo?.render?.frame;
  return frames != null ? frames >= 2 : viser?.document?.querySelector("canvas") != null && viser.__viserTestpoints == null;
}

// The number of the frame that viser shows: the scene has a node of that name (scene3d/scene.py).
function shownFrame(viser) {
  const names = Object.keys(viser?.__viserMutable?.nodeRefFromName ?? {});
  const name = names.find((one) => one.startsWith("/frame/") && viser.__viserMutable.nodeRefFromName[one]);
  return name ? Number(name.slice("/frame/".length)) : null;
}

// The view's background is the page's, in both themes.
function useGround(frame, veil) {
  const theme = useStore((s) => s.theme);
  useEffect(() => {
    const root = frame.current?.contentDocument?.documentElement;
    root?.style.setProperty("--ground", getComputedStyle(document.documentElement).getPropertyValue("--ground"));
  }, [theme, veil]);
}

// The first look follows the object that is chosen, or that the answer is about, until the user has moved the camera.
function useFirstLook(frame, veil) {
  const moved = useRef(false);
  const [id, focus] = useStore((s) => {
    const moment = momentOf(s);
    // Moving a label does not change the frame, so the camera stays.
    const opened = isLabelled(s.frame) ? s.frame.frame : s.frame?.id;
    return [opened, moment && (s.view.obj != null || moment.isAnswer) ? moment.obj : null];
  });
  useEffect(() => {
    moved.current = false;
  }, [id]);
  useEffect(() => {
    const window = veil ? null : frame.current?.contentWindow;
    const move = () => (moved.current = true);
    for (const kind of ["pointerdown", "wheel"]) window?.addEventListener(kind, move, { capture: true, passive: true });
    return () => ["pointerdown", "wheel"].forEach((kind) => window?.removeEventListener(kind, move, { capture: true }));
  }, [veil]);
  useEffect(() => {
    if (focus != null && !moved.current && !isFile) look("first");
  }, [focus, id]);
}

function Tools() {
  const [measuring] = useStore((s) => [s.view.measuring, s.view.scene]);
  const { cloud, box, cut, gizmo, hidden } = sceneOf(state);
  const plain = shownLayers(state).filter(({ color }) => !color);
  const slider = (words, title, value, [min, max, step], set) => html`<label class="slider" title=${title}><span>${words}</span>
    <input type="range" min=${min} max=${max} step=${step} value=${value} onInput=${(e) => set(+e.currentTarget.value)} /></label>`;
  const isClipped = box < WHOLE || cut > 0;
  return html`
    <${Select} title="colours of the observed points" value=${cloud} options=${CLOUDS.map(([value, words = value]) => [value, words])} onChange=${(one) => setScene({ cloud: one })} />
    <${Menu} label="View" title="what else is shown" kind=${isClipped ? "on" : ""}><div class="sliders">
      ${plain.map(({ key, label }) => html`<${Toggle} key=${key} value=${!hidden.includes(key)} title=${`show or hide: ${label}`}
        onChange=${() => toggleLayer(key)}>${label}<//>`)}
      ${slider("Box", "show only what lies in a box around the object in focus", box, [0.6, WHOLE, 0.1], (x) => setScene({ box: x }))}
      ${slider("Cut", "cut the object in focus open from the front", cut, [0, 1, 0.01], (x) => setScene({ cut: x }))}
      ${slider("Handles", "size of the handles of an edited pose", gizmo, [80, 320, 10], (x) => setScene({ gizmo: x }))}
    </div><//>
    <span class="spring" />
    <${Button} title=${titled("measure")} on=${measuring} onClick=${toggleMeasuring}>Measure<//>
    ${CAMERAS.map(({ id, name }) => html`<${Button} key=${id} title=${titled(`camera-${id}`)} onClick=${() => look(id)}>${name}<//>`)}`;
}

/** @param {import("./store.js").State} s */
const shownLayers = (s) => (momentOf(s) ? layersOf(s, momentOf(s)) : []);

function Legend() {
  // As text, so that a moment with the same layers as the one before is not drawn again.
  const [layers] = useStore((s) => [JSON.stringify((isFile ? layersAtEnd(s) : shownLayers(s)).filter(({ color }) => color)
    .map((one) => ({ ...one, isShown: isFile || isLayerShown(s, momentOf(s), one.key) }))), s.view.scene]);
  return html`<div class="layers">${/** @type {(ReturnType<typeof layersOf>[number] & { isShown: boolean })[]} */ (JSON.parse(layers)).map(({ key, label, color, hollow, isShown }) => html`
    <button type="button" key=${key} class=${isShown ? "" : "off"} disabled=${isFile} title=${isFile ? "as it is at the end of the run" : `show or hide: ${label}`}
      onClick=${(e) => { e.currentTarget.blur(); toggleLayer(key); }}>
      <${Swatch} color=${color} hollow=${hollow} /><span>${label}</span></button>`)}</div>`;
}

// Colours of the observed points by their distance to the model.
function ColourBar() {
  const [isShown, tau] = useStore((s) => [sceneOf(s).cloud === "distance to model", s.frame && toleranceOf(s, s.view.branch)]);
  if (!isShown || !tau) return null;
  const anchors = [...palette.scales.blue_red].reverse();
  return html`<div class="colour-bar" title="distance of observed points to the model">
    <i style=${{ background: gradient(anchors) }} />
    <span>−${tau / 2} inside</span><span>0</span><span>outside ${tau / 2} mm</span></div>`;
}
