// The maps pane: a column a map, A above B, all of the same region at the same zoom, with one cross everywhere.
import { html, useEffect, useLayoutEffect, useRef, useState } from "./vendor/htm-preact.js";
import { state, setView, listen, useStore } from "./store.js";
import { momentOf, labelOf } from "./moment.js";
import { Pane, Button, Menu, MenuItem, Parts, Select, number } from "./ui.js";
import { MAPS, CLASSES, gradient, ticks, valueText } from "./colours.js";
import { sidesOf, sideFor, readAt, mapCanvas, hasColour } from "./sides.js";
import { drawCross } from "./drawing.js";
import { fitCanvas, markPixel, setHover, useSize } from "./image.js";

const SHOWN = ["observed", "gain", "rendered", "difference", "angle", "f_d", "f_n", "classes", "observed_rgb", "rendered_rgb", "correlation"];
const PAIRS = { observed: "gain" }; // what A and B share stands in one column, one above the other
const KEY = "verefine-maps";
const HEAD = 1.25; // rem, of a column: its name
const FOOT = 1.5; // its scale with ticks, or the numbers under the mouse
const GAP = 0.4;

const remembered = () => {
  try {
    return JSON.parse(localStorage.getItem(KEY)) ?? [];
  } catch {
    return [];
  }
};
const hiddenOf = (s) => s.view.hiddenMaps ?? remembered();
function toggleMap(name) {
  const hidden = hiddenOf(state);
  const next = hidden.includes(name) ? hidden.filter((n) => n !== name) : [...hidden, name];
  try {
    localStorage.setItem(KEY, JSON.stringify(next));
  } catch {
    // Without storage it holds until the page is left.
  }
  setView({ hiddenMaps: next });
}

// Columns of tiles: [[map, letter], [map, letter]]; the letter of what A and B share is "".
function columnsOf(sides, hidden, large) {
  const names = SHOWN.filter((name) => (hasColour(sides) || !MAPS[name].colour) && (sides.b || name !== "gain"));
  const wanted = names.filter((name) => (large ? name === large : !hidden.includes(name)));
  const columns = [];
  for (const name of wanted) {
    if (!MAPS[name].shared) columns.push(sides.b ? [[name, "a"], [name, "b"]] : [[name, "a"]]);
    else if (Object.values(PAIRS).includes(name) && wanted.includes(Object.keys(PAIRS).find((k) => PAIRS[k] === name))) continue;
    else if (PAIRS[name] && wanted.includes(PAIRS[name])) columns.push([[name, ""], [PAIRS[name], ""]]);
    else columns.push([[name, ""]]);
  }
  return { names, columns };
}

// The part of the image that all maps show: that of A and B together, or where it was zoomed to.
function regionOf(sides) {
  const regions = [sides.a, sides.b].filter((s) => s?.region).map((s) => s.region);
  if (!regions.length) return null;
  const u0 = Math.min(...regions.map((r) => r[0]));
  const v0 = Math.min(...regions.map((r) => r[1]));
  return [u0, v0, Math.max(...regions.map((r) => r[0] + r[2])) - u0, Math.max(...regions.map((r) => r[1] + r[3])) - v0];
}

// How many columns stand in a line so that the maps are as large as can be: { perLine, w, h } of a tile in CSS pixels.
function layoutOf(size, n, rows, aspect, sideBySide) {
  const { rem } = size;
  const [across, down] = sideBySide ? [rows, 1] : [1, rows];
  let best = null;
  for (let perLine = 1; perLine <= n; perLine++) {
    const lines = Math.ceil(n / perLine);
    const w = (size.w - (perLine - 1) * GAP * rem) / perLine / across - (across - 1) * 2;
    const h = ((size.h - (lines - 1) * GAP * rem) / lines - (HEAD + FOOT) * rem - (down - 1) * 2) / down;
    const scale = Math.min(w, h * aspect);
    if (!best || scale > best.scale + 0.5) best = { scale, perLine, w, h, lines };
  }
  // The tile is as wide as its column: the part of the image beside the region is shown as well.
  return { perLine: best.perLine, w: Math.max(best.w, 24), h: Math.max(best.h, 24), across };
}

// Where the region is in a tile: a scale and the place of pixel 0, 0.
function placeOf(zoom, region, w, h) {
  const fit = Math.min(w / region[2], h / region[3]);
  const { share, u, v } = zoom ?? { share: 1, u: region[0] + region[2] / 2, v: region[1] + region[3] / 2 };
  return { scale: fit * share, x: w / 2 - u * fit * share, y: h / 2 - v * fit * share };
}

function paintTile(canvas, name, side, place, size) {
  fitCanvas(canvas, size);
  const ratio = canvas.width / size.w;
  const context = canvas.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.setTransform(ratio * place.scale, 0, 0, ratio * place.scale, ratio * place.x, ratio * place.y);
  if (side) {
    context.imageSmoothingEnabled = place.scale * ratio < 1;
    context.globalAlpha = side.stale ? 0.6 : 1;
    context.drawImage(mapCanvas(name, side), side.region[0], side.region[1]);
    context.globalAlpha = 1;
  }
  const px = 1 / place.scale;
  drawCross(context, state.view.pixel, px, { color: "#ffd23c", reach: 1e5 });
  drawCross(context, state.hover, px, { color: "#ffffff", reach: 8 * px });
}

export function MapsPane() {
  const moment = useStore((s) => momentOf(s));
  useStore((s) => s.view.together);
  return html`<${Pane} name="maps" title="Score maps" tools=${moment && html`<${Tools} moment=${moment} />`}>
    ${moment ? html`<${Maps} />` : ""}<//>`;
}

function Tools({ moment }) {
  const [sides, hidden, large] = useStore((s) => [sidesOf(momentOf(s)), s.view.hiddenMaps, s.view.largeMap]);
  const { names } = columnsOf(sides, [], null);
  const shown = hiddenOf({ view: { hiddenMaps: hidden } });
  return html`
    <${Poses} moment=${moment} letter="a" sides=${sides} />
    ${sides.same ? html`<span class="dim">A and B are the same pose</span>` : html`<${Poses} moment=${moment} letter="b" sides=${sides} />`}
    ${moment.scene.length > 1 && html`<${Button} title="all objects in one depth buffer: as they stand, and ground truth" on=${Boolean(state.view.together)}
      onClick=${() => setView({ together: !state.view.together })}>All objects<//>`}
    ${large ? html`<${Button} title="all maps" onClick=${() => setView({ largeMap: null })}>All maps<//>` : html`
      <${Menu} label="Maps" title="which maps are shown" align="right">${() => names.map((name) => html`
        <${MenuItem} key=${name} on=${!shown.includes(name)} title=${MAPS[name].hint} onClick=${() => toggleMap(name)}>
          ${shown.includes(name) ? "" : "✓ "}${MAPS[name].label}<//>`)}<//>`}`;
}

// One pose: which, its score with parts, and the pixels by class.
function Poses({ moment, letter, sides }) {
  const side = sides[letter];
  const pose = side?.pose;
  if (!pose) return null;
  const score = side && !side.stale ? side.score : null;
  const names = Object.keys(moment.poses).filter((name) => moment.poses[name].T);
  const choose = (name) => {
    const other = letter === "a" ? moment.b : moment.a;
    setView({ a: moment.a?.name, b: moment.b?.name, ...(other ? {} : { a: name }), [letter]: name });
  };
  return html`<div class="posed"><b class=${`letter ${letter}`}>${letter.toUpperCase()}</b>
    ${pose.branch == null && pose.T
      ? html`<${Select} title=${`pose ${letter.toUpperCase()}`} value=${pose.name} onChange=${choose} options=${names.map((name) => [name, labelOf(name, moment)])} />`
      : html`<span class="named" title=${pose.label}>${pose.label}</span>`}
    <strong title="score">${number(score?.score ?? pose.score, 3)}</strong>
    <span class="dim fits" title="depth fit, normal fit${score?.colour_fit != null ? ", colour" : ""}">d ${number(score?.depth_fit)} n ${number(score?.normal_fit)}${score?.colour_fit != null ? ` c ${number(score.colour_fit)}` : ""}</span>
    ${score?.err != null && html`<span class="dim err" title=${`ADD(-S); ${number(score.deg, 1)}° and ${number(score.mm, 1)} mm from the truth`}>${number(score.err, 1)} mm</span>`}
    <span class="class-bar">${score && html`<${Parts} parts=${CLASSES.map((c) => [c.name, score.counts[c.name], c.color])} />`}</span>
    ${side?.gone && html`<span class="bad" title=${side.gone}>no maps</span>`}</div>`;
}

function Maps() {
  const [sides, hidden, large] = useStore((s) => [sidesOf(momentOf(s)), s.view.hiddenMaps, s.view.largeMap, s.theme]);
  const [root, size] = useSize();
  const [zoom, setZoom] = useState(null);
  const { columns } = columnsOf(sides, hiddenOf({ view: { hiddenMaps: hidden } }), large);
  const region = regionOf(sides);
  const rows = Math.max(1, ...columns.map((c) => c.length));
  const layout = size && region && columns.length ? layoutOf(size, columns.length, rows, region[2] / region[3], Boolean(large)) : null;
  return html`<div class="maps-area" ref=${root}>
    ${columns.length === 0 && html`<p class="empty">no map is chosen</p>`}
    ${layout && html`<div class="map-columns" style=${{ gridTemplateColumns: `repeat(${layout.perLine}, 1fr)` }}>
      ${columns.map((tiles) => html`<${Column} key=${tiles[0][0]} tiles=${tiles} sides=${sides} layout=${layout} rows=${rows}
        region=${region} zoom=${zoom} setZoom=${setZoom} large=${large} />`)}
    </div>`}
  </div>`;
}

function Column({ tiles, sides, layout, rows, region, zoom, setZoom, large }) {
  const [name] = tiles[0];
  const scaled = tiles.at(-1)[0]; // of two maps in one column the scale of the lower one; the upper one has that of its neighbour
  const map = MAPS[name];
  const across = large && tiles.length > 1 ? tiles.length : 1;
  const w = across > 1 ? layout.w : layout.w * layout.across;
  return html`<section class="map-column">
    <button type="button" class="map-name" title=${`${map.hint}; click: ${large ? "all maps" : "large"}`}
      onClick=${(e) => { e.currentTarget.blur(); setView({ largeMap: large ? null : name }); }}>${map.label}</button>
    <div class=${`map-tiles ${across > 1 ? "beside" : ""}`} style=${{ height: `${across > 1 || large ? layout.h : layout.h * rows + 2 * (rows - 1)}px` }}>
      ${tiles.map(([one, letter]) => html`<${Tile} key=${one + letter} name=${one} letter=${letter} sides=${sides} zoom=${zoom} setZoom=${setZoom}
        region=${region} size=${{ w, h: tiles.length < rows && !large ? layout.h * rows + 2 * (rows - 1) : layout.h }} />`)}
    </div>
    <${Foot} name=${scaled} tiles=${tiles} sides=${sides} />
  </section>`;
}

const BADGES = { gain: "gain of B", a: "A", b: "B" };
function Tile({ name, letter, sides, region, size, zoom, setZoom }) {
  const canvas = useRef();
  const paint = useRef();
  const drag = useRef(null);
  const side = sideFor(name, sides, letter || "a");
  const place = placeOf(zoom, region, size.w, size.h);
  paint.current = () => canvas.current && paintTile(canvas.current, name, side, place, size);
  useEffect(() => {
    let before = "";
    return listen(() => {
      const now = `${state.hover} ${state.view.pixel}`;
      if (now !== before) paint.current();
      before = now;
    });
  }, []);
  useLayoutEffect(() => paint.current());
  const at = (event) => {
    const box = canvas.current.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    return { x, y, pixel: inImage([Math.floor((x - place.x) / place.scale), Math.floor((y - place.y) / place.scale)]) };
  };
  const fit = Math.min(size.w / region[2], size.h / region[3]);
  const toZoom = ({ scale, x, y }) => setZoom({ share: scale / fit, u: (size.w / 2 - x) / scale, v: (size.h / 2 - y) / scale });
  const move = (event) => {
    const now = at(event);
    setHover(now.pixel);
    if (!drag.current) return;
    const [dx, dy] = [now.x - drag.current.x, now.y - drag.current.y];
    drag.current.far ||= Math.hypot(dx, dy) > 3;
    if (drag.current.far) toZoom({ scale: place.scale, x: drag.current.place.x + dx, y: drag.current.place.y + dy });
  };
  const wheel = (event) => {
    event.preventDefault();
    const { x, y } = at(event);
    const scale = Math.min(Math.max(place.scale * Math.exp(-0.0016 * event.deltaY), fit), 40 * fit);
    if (scale <= fit * 1.001) return setZoom(null);
    const by = scale / place.scale;
    return toZoom({ scale, x: x - (x - place.x) * by, y: y - (y - place.y) * by });
  };
  const badge = BADGES[name] ?? BADGES[letter];
  return html`<div class="map-tile" style=${{ width: `${size.w}px`, height: `${size.h}px` }}>
    <canvas ref=${canvas}
      onPointerDown=${(e) => { drag.current = { ...at(e), place, far: false }; canvas.current.setPointerCapture(e.pointerId); }}
      onPointerMove=${move} onPointerLeave=${() => drag.current || setHover(null)} onPointerCancel=${() => (drag.current = null)}
      onPointerUp=${(e) => { const { far } = drag.current ?? { far: true }; drag.current = null; if (!far && at(e).pixel) markPixel(at(e).pixel); }}
      onWheel=${wheel} onDblClick=${() => setZoom(null)} />
    ${badge && html`<span class=${`corner ${letter}`} title=${name === "gain" ? MAPS.gain.hint : ""}>${badge}</span>`}
    ${!side && html`<span class="waiting">…</span>`}
  </div>`;
}
function inImage([u, v]) {
  const { w, h } = state.frame.camera;
  return u >= 0 && v >= 0 && u < w && v < h ? [u, v] : null;
}

const colorOf = (name) => CLASSES.find((c) => c.name === name).color;

// The scale with its ticks; while a pixel is pointed at or marked, its numbers in their place.
function Foot({ name, tiles, sides }) {
  const pixel = useStore((s) => s.hover ?? s.view.pixel);
  const map = MAPS[name];
  const like = sideFor(name, sides, "a") ?? sideFor(name, sides, "b");
  const read = pixel && tiles.map(([one, letter]) => {
    const side = sideFor(one, sides, letter || "a");
    const value = side?.stale ? null : readAt(one, side, pixel);
    return { letter: letter || (one === "gain" ? "gain" : ""), text: valueText(MAPS[one], value), value };
  });
  const values = read?.some((v) => v.value != null) ? read : null;
  return html`<div class="map-foot">
    <div class="ramp" style=${map.anchors ? { background: gradient(map.anchors) } : {}}>
      ${map.classes && CLASSES.map((c) => html`<i style=${{ background: c.color }} title=${`${c.name}: ${c.words}`} />`)}
      ${map.marks && [25, 75].map((x) => html`<u style=${{ left: `${x}%` }} title="τ" />`)}
    </div>
    <div class=${`line ${values ? "values" : ""}`}>${values ? html`${values.map((v) => html`<span class=${`of ${v.letter}`}>
        ${tiles.length > 1 && html`<b>${{ a: "A", b: "B", gain: "gain" }[v.letter] ?? ""}</b>`}
        ${Array.isArray(v.value) ? html`<em style=${{ background: `rgb(${v.value})` }} />` : typeof v.value === "string" ? html`<em style=${{ background: colorOf(v.value) }} />${v.text}` : v.text}</span>`)}
        ${tiles[0][0] === name && map.unit && html`<small>${map.unit}</small>`}`
      : map.anchors && like ? ticks(map, like).map((t, i) => html`<span>${t}${i === 2 && map.unit && !map.ends ? html` <small>${map.unit}</small>` : ""}</span>`)
      : map.classes ? [CLASSES[0], CLASSES.at(-1)].map((c) => html`<span title=${c.words}>${c.name}</span>`) : ""}</div>
  </div>`;
}
