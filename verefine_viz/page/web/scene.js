// The 3D view: viser's page in a frame. It follows the window used last.
import { html, useEffect, useRef, useState } from "./vendor/htm-preact.js";
import { state, send, useStore } from "./store.js";
import { addKeys, attachKeys, titled } from "./keys.js";
import { lookOf } from "./messages.js";
import { momentOf } from "./moment.js";
import { sidesOf } from "./sides.js";
import { isFile, scenePage } from "./file.js";
import { Button, Pane } from "./ui.js";

const LATEST_MS = 3000;

// viser would draw with fewer pixels by itself after some slow pictures, and seldom come back.
const ADDRESS = `/3d/?darkMode&fixedDpr=${devicePixelRatio}`;
const CAMERAS = [
  { id: "object", key: "c", name: "Object", title: "3D: camera to the object in focus, where it is not hidden" },
  { id: "sensor", key: "C", name: "Sensor", title: "3D: camera to where the sensor was" },
  { id: "first", key: "x", name: "First", title: "3D: camera back to the first view" },
];

const look = (camera = null) => {
  const verb = lookOf(state);
  if (verb) send({ ...verb, camera });
};
addKeys(CAMERAS.map(({ id, key, title }) => ({ id: `camera-${id}`, keys: [key], title, group: "Show", action: () => look(id) })));

export function ScenePane() {
  const frame = useRef();
  const [drawn, setDrawn] = useState(false);
  const [window, follows, connection] = useStore((s) => [s.window, s.scene3d, s.connection]);
  // Loaded once the first maps are there: viser's page takes the processor for a second or two.
  const pictured = useStore((s) => Boolean(momentOf(s) && sidesOf(momentOf(s)).a?.arrays));
  const [begun, begin] = useState(false);
  useEffect(() => {
    if (pictured) begin(true);
    const late = setTimeout(() => begin(true), LATEST_MS);
    return () => clearTimeout(late);
  }, [pictured]);
  const [page, setPage] = useState(undefined); // of a file; null = it has none
  useEffect(() => {
    if (isFile && begun) scenePage().then(setPage);
  }, [begun]);
  useEffect(() => {
    if (drawn) return undefined;
    const waiting = setInterval(() => hasDrawn(frame.current?.contentWindow) && setDrawn(true), 200);
    return () => clearInterval(waiting);
  }, [drawn]);
  const loaded = () => {
    setDrawn(false);
    if (begun) attachKeys(frame.current.contentWindow);
  };
  const elsewhere = follows != null && window != null && follows !== window;
  if (isFile && page === null) return html`<${Pane} name="scene" title="3D"><p class="empty">The file holds no 3D view.</p><//>`;
  const tools = html`<span class="spring" />${!isFile && CAMERAS.map(({ id, name }) => html`
    <${Button} key=${id} title=${titled(`camera-${id}`)} onClick=${() => look(id)}>${name}<//>`)}`;
  return html`<${Pane} name="scene" title=${isFile ? "3D at the end" : "3D"} tools=${tools}>
    <iframe ref=${frame} ...${isFile ? { srcdoc: page } : { src: begun ? ADDRESS : undefined }} title="3D view" onLoad=${loaded} />
    ${!drawn && html`<div class="loading">${connection === "lost" ? "The server does not answer." : "Loading the 3D view"}</div>`}
    ${elsewhere && html`<button type="button" class="elsewhere" title="let the 3D view follow this window" onClick=${() => look()}>3D follows another window: show this one</button>`}
  <//>`;
}

// Whether viser has drawn a picture; where it does not say how many, whether it has something to draw on.
function hasDrawn(viser) {
  const frames = viser?.__viserTestpoints?.rendererInfo?.render?.frame;
  return frames != null ? frames >= 2 : viser?.document?.querySelector("canvas") != null && viser.__viserTestpoints == null;
}
