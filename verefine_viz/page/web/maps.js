// The maps pane: a column a map, A above B, all of the same region at the same zoom, with one cross everywhere.
import { html } from "htm/preact";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { state, setView, listen, useStore } from "./store.js";
import { momentOf, labelOf } from "./moment.js";
import { seek } from "./cursor.js";
import { mark } from "./marking.js";
import { Pane, Button, Menu, MenuItem, Parts, Select, number } from "./ui.js";
import { anchorsOf, MAPS, gradient, ticks, valueText } from "./colours.js";
import { palette } from "./palette.js";
import { sidesOf, sideFor, readAt, mapCanvas, hasColour } from "./sides.js";
import { drawCross } from "./drawing.js";
import { remember } from "./layout.js";
import { fitCanvas, inImage, setHover, useSize, zoomed } from "./image.js";

const ORDER = ["observed", "gain", "rendered", "difference", "angle", "f_d", "f_n", "classes", "observed_rgb",
  "rendered_rgb", "correlation"];
const BELOW = { observed: "gain" }; // two maps that A and B share, in one column
const HEAD = 1.25; // rem: the name of a column
const FOOT = 1.5; // its scale, and the numbers under the mouse
const NARROW = 9.5; // a column that is no wider has those of A and B below each other
const FOOT_OF_NARROW = 2.4;
const GAP = 0.4; // between columns
const RIM = 2; // px, between A and B

function toggleMap(name) {
  const { hiddenMaps } = state;
  remember({ hiddenMaps: hiddenMaps.includes(name) ? hiddenMaps.filter((n) => n !== name) : [...hiddenMaps, name] });
}

// Layout

const namesOf = (sides) => ORDER.filter((n) => (hasColour(sides) || !MAPS[n].colour) && (sides.b || n !== "gain"));

// Columns of tiles [[map, letter], …]; the letter of what A and B share is "".
function columnsOf(sides, names) {
  const columns = [];
  for (const name of names) {
    const above = Object.keys(BELOW).find((n) => BELOW[n] === name);
    if (!MAPS[name].shared) columns.push(sides.b ? [[name, "a"], [name, "b"]] : [[name, "a"]]);
    else if (names.includes(BELOW[name])) columns.push([[name, ""], [BELOW[name], ""]]);
    else if (!names.includes(above)) columns.push([[name, ""]]);
  }
  return columns;
}

// The part of the image that holds the maps of A and of B.
function regionOf(sides) {
  const regions = [sides.a, sides.b].filter((side) => side?.region).map((side) => side.region);
  if (!regions.length) return null;
  const [u0, v0] = [0, 1].map((i) => Math.min(...regions.map((r) => r[i])));
  const [u1, v1] = [0, 1].map((i) => Math.max(...regions.map((r) => r[i] + r[i + 2])));
  return [u0, v0, u1 - u0, v1 - v0];
}

// How many columns stand in a line, and whether the tiles of a column stand beside each other, so that the region is as
// large as can be; and the size of a tile [px]. A tile takes its column's whole width: what lies beside the region is
// shown as well. `large`: one map alone, whose tiles stand beside each other.
function layoutOf(size, n, rows, region, large) {
  let best = null;
  const beside = (/** @type {number} */ perLine) => (large ? [true] : rows > 1 && perLine < n ? [false, true] : [false]);
  const all = [...Array(n).keys()].flatMap((i) => beside(i + 1).map((b) => /** @type {const} */ ([i + 1, b])));
  for (const [perLine, isBeside] of all) {
    const [across, down] = isBeside ? [rows, 1] : [1, rows];
    const lines = Math.ceil(n / perLine);
    const width = (size.w - (perLine - 1) * GAP * size.rem) / perLine;
    const height = (size.h - (lines - 1) * GAP * size.rem) / lines - (HEAD + (width <= NARROW * size.rem ? FOOT_OF_NARROW : FOOT)) * size.rem;
    const w = Math.max((width - (across - 1) * RIM) / across, 24);
    const h = Math.max((height - (down - 1) * RIM) / down, 24);
    const scale = Math.min(w / region[2], h / region[3]);
    if (!best || scale > best.scale * 1.01) best = { scale, perLine, w, h, rows, large, beside: isBeside };
  }
  return best;
}

// Where the image is in a tile: a scale [px a pixel] and the place of pixel 0, 0.
function placeOf(zoom, region, { w, h }) {
  const fit = Math.min(w / region[2], h / region[3]);
  const { share, u, v } = zoom ?? { share: 1, u: region[0] + region[2] / 2, v: region[1] + region[3] / 2 };
  return { scale: fit * share, x: w / 2 - u * fit * share, y: h / 2 - v * fit * share, fit };
}

// The pane

export function MapsPane() {
  const moment = useStore(momentOf);
  const tools = moment && html`<${Tools} moment=${moment} />`;
  return html`<${Pane} name="maps" title="Score maps" tools=${tools}>${moment ? html`<${Maps} />`
    : state.frame && html`<p class="empty">This frame has no object yet.</p>`}<//>`;
}

function Tools({ moment }) {
  const [sides, large, together] = useStore((s) =>
    [sidesOf(momentOf(s)), s.view.largeMap, Boolean(s.view.together), s.hiddenMaps]);
  const hidden = state.hiddenMaps;
  const item = (name) => html`<${MenuItem} key=${name} on=${!hidden.includes(name)} title=${MAPS[name].hint}
    onClick=${() => toggleMap(name)}>${hidden.includes(name) ? "" : "✓ "}${MAPS[name].label}<//>`;
  return html`
    <${Posed} moment=${moment} letter="a" side=${sides.a} />
    ${sides.same ? html`<span class="dim">A and B are the same pose</span>`
      : html`<${Posed} moment=${moment} letter="b" side=${sides.b} />`}
    ${moment.scene.length > 1 && html`<${Button} on=${together}
      title=${`all objects in one depth buffer: as they stand${moment.scene.some((o) => o.object.gt) ? ", and ground truth" : ""}`}
      onClick=${() => setView({ together: !together })}>All objects<//>`}
    ${large ? html`<${Button} title="all maps" onClick=${() => setView({ largeMap: null })}>All maps<//>`
      : html`<${Menu} label="Maps" title="which maps are shown" align="right">${() => namesOf(sides).map(item)}<//>`}`;
}

// One pose: which, its score with parts, and its pixels by class.
function Posed({ moment, letter, side }) {
  const pose = side?.pose;
  if (!pose) return null;
  const score = side.stale ? null : side.score;
  const title = `pose ${letter.toUpperCase()}`;
  const options = Object.keys(moment.poses).filter((name) => moment.poses[name].T).map((n) => [n, labelOf(n, moment)]);
  const choose = (name) => setView({ a: moment.a?.name ?? null, b: moment.b?.name ?? null, [letter]: name });
  const fits = [["d", "depth fit", score?.depth_fit], ["n", "normal fit", score?.normal_fit],
    ["c", "colour", score?.colour_fit], ["p", "plausibility", score?.plausibility]];
  const shown = fits.filter(([letter, , x]) => letter === "d" || letter === "n" || x != null);
  const error = `ADD(-S); ${number(score?.deg, 1)}° and ${number(score?.mm, 1)} mm from ground truth`;
  const parts = score && palette.classes.map((c) => [c.name, score.counts[c.name], c.color]);
  return html`<div class="posed"><b class=${`letter ${letter}`}>${letter.toUpperCase()}</b>
    ${pose.T && pose.branch == null
      ? html`<${Select} title=${title} value=${pose.name} onChange=${choose} options=${options} />`
      : html`<span class="named" title=${pose.label}>${pose.label.replace(/^[AB]: /, "")}</span>`}
    <strong title="score">${number(score?.score ?? pose.score, 3)}</strong>
    ${!side.gone && html`<span class="dim" title=${shown.map(([, words]) => words).join(", ")}>
      ${shown.map(([letter, , x]) => `${letter} ${number(x)}`).join(" ")}</span>`}
    ${score?.err != null && html`<span class="dim err" title=${error}>${number(score.err, 1)} mm</span>`}
    <span class="class-bar">${parts && html`<${Parts} parts=${parts} />`}</span>
    ${side.gone && html`<span class="dim" title=${side.gone}>no maps</span>`}</div>`;
}

function Maps() {
  const [sides, large] = useStore((s) => {
    const sides = sidesOf(momentOf(s));
    return [sides, s.view.largeMap, s.hiddenMaps, sideFor("observed", sides), sideFor("observed_rgb", sides)];
  });
  const [root, size] = useSize();
  const [zoom, setZoom] = useState(null);
  const hidden = state.hiddenMaps;
  const columns = columnsOf(sides, namesOf(sides).filter((name) => (large ? name === large : !hidden.includes(name))));
  const region = regionOf(sides);
  const rows = Math.max(1, ...columns.map((tiles) => tiles.length));
  const layout = size && region && columns.length
    ? layoutOf(size, columns.length, rows, region, Boolean(large)) : null;
  const shared = { sides, layout, region, zoom, setZoom };
  return html`<div class="maps-area" ref=${root}>
    ${columns.length === 0 && html`<p class="empty">No map is chosen.</p>`}
    ${!region && (sides.a?.gone || sides.b?.gone) && html`<${Gone} why=${sides.a?.gone ?? sides.b.gone} />`}
    ${layout && html`<div class="map-columns" style=${{ gridTemplateColumns: `repeat(${layout.perLine}, 1fr)` }}>
      ${columns.map((tiles) => html`<${Column} key=${tiles[0][0]} tiles=${tiles} ...${shared} />`)}</div>`}
  </div>`;
}

// Why there are no maps; and where a file, which has those of marked iterations, has some.
function Gone({ why }) {
  const moment = useStore(momentOf);
  const marks = state.file?.maps === "marked" ? moment.run.marks.filter((m) => m.tone !== "switched").map((m) => m.k) : [];
  const named = state.verdicts.get(moment.branch)?.objects.flatMap((o) => [o.k, ...o.findings.map((f) => f.k)]) ?? [];
  const ks = state.file ? [...marks, ...named.filter((k) => k > 0), moment.run.rows.length].sort((a, b) => a - b) : [];
  const near = [ks.findLast((k) => k < moment.k), ks.find((k) => k > moment.k)].filter((k) => k != null);
  return html`<div class="empty"><p>${why}</p><div class="group">${near.map((k) => html`
    <${Button} key=${k} title="go there" onClick=${() => seek(k)}>Iteration ${k}<//>`)}</div></div>`;
}

function Column({ tiles, layout, ...shared }) {
  const [name] = tiles[0];
  const { w, h, rows, large, beside } = layout;
  // What A and B share takes the place of both.
  const isLone = tiles.length < rows && !beside;
  const size = { w, h: isLone ? h * rows + RIM * (rows - 1) : h };
  const enlarge = (event) => {
    event.currentTarget.blur();
    setView({ largeMap: large ? null : name });
  };
  return html`<section class="map-column">
    <button type="button" class="map-name" onClick=${enlarge}
      title=${`${MAPS[name].hint}; click: ${large ? "all maps" : "large"}`}>${MAPS[name].label}</button>
    <div class=${`map-tiles ${beside ? "beside" : ""}`}>${tiles.map(([one, letter]) => html`
      <${Tile} key=${one + letter} name=${one} letter=${letter} size=${size} ...${shared} />`)}</div>
    <${Foot} name=${tiles.at(-1)[0]} tiles=${tiles} sides=${shared.sides} />
  </section>`;
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

function Tile({ name, letter, sides, region, size, zoom, setZoom }) {
  const canvas = useRef(null);
  const paint = useRef(null);
  const drag = useRef(null);
  const side = sideFor(name, sides, letter || "a");
  const place = placeOf(zoom, region, size);
  paint.current = () => canvas.current && paintTile(canvas.current, name, side, place, size);
  useLayoutEffect(() => paint.current());
  useEffect(() => {
    let before = "";
    return listen(() => {
      const crosses = `${state.hover} ${state.view.pixel}`;
      if (crosses !== before) paint.current();
      before = crosses;
    });
  }, []);

  const at = (event) => {
    const box = canvas.current.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    return { x, y, pixel: inImage((x - place.x) / place.scale, (y - place.y) / place.scale) };
  };
  const setPlace = ({ scale, x, y }) => {
    const share = scale / place.fit;
    setZoom(share > 1.001 ? { share, u: (size.w / 2 - x) / scale, v: (size.h / 2 - y) / scale } : null);
  };
  const onPointerDown = (event) => {
    drag.current = { ...at(event), place, far: false };
    canvas.current.setPointerCapture(event.pointerId);
  };
  const onPointerMove = (event) => {
    const now = at(event);
    const start = drag.current;
    setHover(now.pixel);
    if (!start) return;
    const [dx, dy] = [now.x - start.x, now.y - start.y];
    start.far ||= Math.hypot(dx, dy) > 3;
    if (start.far) setPlace({ scale: place.scale, x: start.place.x + dx, y: start.place.y + dy });
  };
  const onPointerUp = () => {
    const start = drag.current;
    drag.current = null;
    if (start && !start.far && start.pixel) mark(start.pixel);
  };
  const onWheel = (event) => {
    event.preventDefault();
    setPlace(zoomed(place, Math.exp(-0.0016 * event.deltaY), at(event), place.fit, 40 * place.fit));
  };
  const onPointerCancel = () => (drag.current = null);
  const onPointerLeave = () => drag.current || setHover(null);
  const onDblClick = () => setZoom(null);
  const mouse = { onPointerDown, onPointerMove, onPointerUp, onPointerCancel, onPointerLeave, onWheel, onDblClick };
  const corner = name === "gain" ? "gain of B" : letter.toUpperCase();
  const gone = letter ? sides[letter]?.gone : sides.a?.gone ?? sides.b?.gone;
  return html`<div class="map-tile" style=${{ width: `${size.w}px`, height: `${size.h}px` }}>
    <canvas ref=${canvas} ...${mouse} />
    ${corner && html`<span class=${`corner ${letter}`} title=${name === "gain" ? MAPS.gain.hint : undefined}>${corner}</span>`}
    ${!side && (gone ? html`<span class="waiting" title=${gone}>–</span>` : html`<span class="waiting">…</span>`)}
  </div>`;
}

// The scale with its ticks; while a pixel is pointed at or marked, its numbers in place of the ticks.
function Foot({ name, tiles, sides }) {
  const pixel = useStore((s) => s.hover ?? s.view.pixel);
  const map = MAPS[name];
  const like = sideFor(name, sides, "a") ?? sideFor(name, sides, "b");
  const values = tiles.map(([one, letter]) => {
    const side = sideFor(one, sides, letter || "a");
    return { one, letter, value: side?.stale ? null : readAt(one, side, pixel) };
  });
  const isRead = values.some(({ value }) => value != null);
  return html`<div class="map-foot">
    <div class="ramp" style=${map.colours ? { background: gradient(anchorsOf(map)) } : {}}>
      ${map.classes && palette.classes.map(({ name: own, color, words }) => html`
        <i style=${{ background: color }} title=${`${own}: ${words}`} />`)}
      ${map.marks && [25, 75].map((x) => html`<u style=${{ left: `${x}%` }} />`)}
    </div>
    ${isRead ? html`<div class="line values">
        ${values.map((v) => html`<${Value} ...${v} isAlone=${tiles.length === 1} />`)}
        ${tiles[0][0] === name && map.unit && html`<small>${map.unit}</small>`}</div>`
      : html`<div class=${`line ticks ${map.classes ? "names" : ""}`}><${Ticks} map=${map} side=${like} /></div>`}
  </div>`;
}

function Value({ one, letter, value, isAlone }) {
  const color = Array.isArray(value) ? `rgb(${value})` : palette.classes.find((c) => c.name === value)?.color;
  const prefix = one === "gain" ? "gain" : letter.toUpperCase();
  const text = Array.isArray(value) ? "" : valueText(MAPS[one], value);
  return html`<span class=${`of ${letter}`} title=${MAPS[one].hint}>${!isAlone && prefix && html`<b>${prefix}</b>`}
    ${color && html`<em style=${{ background: color }} />`}${text}</span>`;
}

function Ticks({ map, side }) {
  if (map.classes) return [palette.classes[0], palette.classes.at(-1)].map((c) => html`<span title=${c.words}>${c.name}</span>`);
  if (!map.colours || !side) return null;
  const [low, middle, high] = ticks(map, side);
  const unit = map.unit && html`<small>${map.unit}</small>`;
  return html`<span>${low}</span><span>${middle}</span><span>${high}${unit}</span>`;
}
