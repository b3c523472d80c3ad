// What physics says: whether each object can stand where it is, and what the simulation did step by step.
import { html } from "htm/preact";
import { useEffect, useMemo, useState } from "preact/hooks";
import { listen, send, setView, state, useStore } from "../store.js";
import { labelOf, momentOf } from "../moment.js";
import { palette, stageColor } from "../palette.js";
import { showLayer } from "../scene_layers.js";
import { Button, columnsOf, number, Select, Swatch, Table } from "../ui.js";
import { Chart } from "../charts.js";
import { useLatest } from "./latest.js";
import { physicsOf } from "../wants.js";
import { settingsOf } from "./setting.js";

/** @import { PhysicsAnswer, PosePhysics, SimulatedMotion, SupportAround } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */

export const title = "Physics";
export const hint = "whether the objects can stand so, and the simulation";
export const needs = (/** @type {import("../store.js").State} */ s) => Boolean(momentOf(s)?.scene.some((o) => o.T));
export const empty = "No object has a pose.";

export const LIGHTS = { green: ["check", "stable", "good"], amber: ["warn", "marginal", "doubt"], red: ["cross", "impossible", "bad"], grey: ["question", "unknown", "dim"] };
const PLAY_MS = 120;

export function render() {
  const moment = useStore(momentOf);
  const asked = useMemo(() => physicsOf(state, moment), [moment]);
  const answer = useLatest(asked, "physics", `${moment.branch} ${moment.obj}`);
  if (!answer) return html`<p class="empty">Working out what touches what.</p>`;
  if ("gone" in answer) return html`<p class="empty">${answer.gone}</p>`;
  return html`<div class="tab physics">
    ${answer.empty && html`<p class="summary">${answer.empty}</p>`}
    ${answer.doubts.map((d) => html`<p class="doubt">${d}</p>`)}
    <${Focus} answer=${answer} moment=${moment} />
    <${Path} path=${answer.path} moment=${moment} />
    <${Scene} answer=${answer} moment=${moment} />
    <${Around} around=${answer.surroundings} branch=${moment.branch} />
  </div>`;
}

const Light = ({ tone }) => html`<i class=${`light ${tone}`} title=${LIGHTS[tone]?.[1]} />`;

/**
 * The object in focus: before and after, in numbers and seen from above.
 * @param {{ answer: PhysicsAnswer, moment: Moment }} props
 */
function Focus({ answer, moment }) {
  const { poses } = answer;
  if (!poses.length) return null;
  const main = poses.at(-1);
  /** @type {[string, string, (p: PosePhysics) => unknown][]} */
  const rows = [
    ["gap mm", "distance to the nearest surface", (p) => number(p.gap_mm, 1)],
    ["overlap mm", "deepest penetration, and into what", (p) => (p.into ? html`${number(p.depth_mm, 1)} <span class="dim">${p.into}</span>` : "none")],
    ["balance mm", "centre of mass to the edge of the support polygon; negative: outside, it tips over", (p) => (p.margin_mm == null ? "no support" : number(p.margin_mm, 1))],
    ["stable", "whether friction at the contacts can hold it still; contacts deep inside a surface cannot tell", (p) => (p.stable == null ? "unknown" : p.stable ? "yes" : "no")],
    ["near", "what it touches, or would with the gap closed", (p) => p.touches?.join(", ") || "nothing"],
  ];
  return html`<h3>${moment.object.label}</h3>
    ${poses.map((p) => html`<p class=${`light-words ${p.tone}`}><b>${labelOf(p.name, moment)}</b> ${p.words}</p>`)}
    <div class="focus"><table class="table"><thead><tr><th class="left"></th>${poses.map((p) => html`<th><${Swatch} color=${stageColor(p.name)} />${labelOf(p.name, moment)}</th>`)}</tr></thead>
      <tbody>${rows.map(([name, what, cell]) => html`<tr title=${what}><td class="left">${name}</td>${poses.map((p) => html`<td>${cell(p)}</td>`)}</tr>`)}</tbody></table>
      ${main.outline && html`<${FromAbove} pose=${main} label=${labelOf(main.name, moment)} />`}</div>`;
}

/**
 * Outline, contacts, support polygon and centre of mass from above, with a ruler.
 * @param {{ pose: PosePhysics, label: string }} props
 */
function FromAbove({ pose, label }) {
  const all = [...pose.outline, ...pose.polygon, pose.com];
  const [xs, ys] = [all.map((p) => p[0]), all.map((p) => p[1])];
  const size = Math.max(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys), 1) * 1.12;
  const [cx, cy] = [(Math.max(...xs) + Math.min(...xs)) / 2, (Math.max(...ys) + Math.min(...ys)) / 2];
  const at = ([x, y]) => [((x - cx) / size) * 100 + 50, 50 - ((y - cy) / size) * 100];
  const line = (points) => points.map((p) => at(p).map((v) => v.toFixed(2)).join()).join(" ");
  const [x, y] = at(pose.com);
  const ruler = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].findLast((mm) => mm < size / 2.2) ?? 1;
  const shape = pose.polygon.length > 2 ? "polygon" : "polyline";
  return html`<figure class="above"><svg viewBox="0 0 100 108" class=${pose.tone}>
      <polygon class="outline" points=${line(pose.outline)} />
      ${pose.polygon.length > 0 && html`<${shape} class="support" points=${line(pose.polygon)} />`}
      ${pose.contacts.map((c) => html`<circle class="contact" cx=${at(c)[0]} cy=${at(c)[1]} r="1.1" />`)}
      <path class="com" d=${`M${x - 4} ${y}h8M${x} ${y - 4}v8`} />
      <path class="ruler" d=${`M3 105h${(ruler / size) * 100}M3 103.5v3M${3 + (ruler / size) * 100} 103.5v3`} /><text x=${6 + (ruler / size) * 100} y="106.6">${ruler} mm</text>
    </svg><figcaption>${label} from above: outline, <span class="support">support</span>, + centre of mass</figcaption></figure>`;
}

// The simulated path: what moved, what was touched and how hard; its moments are drawn in 3D.
let timer = null; // while the path is played
const playing = () => timer != null;
function stop() {
  clearInterval(timer);
  timer = null;
}
function play(n) {
  if (playing()) return stop();
  if (state.view.moment == null || state.view.moment >= n - 1) showMoment(0);
  let shown = state.view.moment ?? 0;
  timer = setInterval(() => {
    if (state.view.moment !== shown || shown >= n - 1) return setView({ moment: state.view.moment ?? shown }), stop();
    shown += 1;
    setView({ moment: shown });
  }, PLAY_MS);
  return undefined;
}
listen(() => state.view.moment == null && stop());

// A moment of the path is seen with what the object touches then.
function showMoment(moment) {
  showLayer("contacts", true);
  setView({ moment });
}
function hideMoment() {
  showLayer("contacts", false);
  setView({ moment: null });
}

/** @param {{ path: SimulatedMotion | null, moment: Moment }} props */
function Path({ path, moment }) {
  const at = useStore((s) => s.view.moment);
  const [what, setWhat] = useState("moved");
  useEffect(() => stop, []);
  if (!path) return html`<p class="dim">${moment.row ? `Nothing was simulated in iteration ${moment.row.k}.` : "Nothing was simulated yet."}</p>`;
  const shown = Math.min(at ?? path.n - 1, path.n - 1);
  const contacts = shown > 0 ? path.contacts[shown - 1] : [];
  const names = [...new Set(path.contacts.flat().map((c) => c.name))];
  const x = [...Array(path.n).keys()];
  const colors = ["#ff8c00", "#4aa3c7", "#b58ad6", "#8a8a8a"];
  const series = {
    moved: [{ name: "moved", values: path.moved_mm, color: palette.stages.simulated }],
    turned: [{ name: "turned", values: path.turned_deg, color: palette.stages.simulated }],
    force: names.map((name, i) => ({ name, color: colors[i % 4], values: x.map((k) => (k ? path.contacts[k - 1].find((c) => c.name === name)?.force_n ?? 0 : null)) })),
  }[what];
  return html`<h3>Simulation of iteration ${path.k}</h3>
    <p>${path.n - 1} step${path.n === 2 ? "" : "s"}: moved ${number(path.moved_mm.at(-1), 1)} mm, turned ${number(path.turned_deg.at(-1), 1)}°. ${path.words}</p>
    <div class="row"><${Button} icon=${playing() ? "pause" : "run"} title="play the simulated path in 3D" onClick=${() => play(path.n)}>${playing() ? "Pause" : "Play"}<//>
      <input type="range" min="0" max=${path.n - 1} value=${shown} title="moment of the path; the 3D view shows it" onInput=${(e) => showMoment(Number(e.currentTarget.value))} />
      <span class="number">step ${shown} of ${path.n - 1}</span>
      <${Button} disabled=${at == null} title="draw the path no more" onClick=${hideMoment}>Hide<//></div>
    ${path.n > 2 && html`<div class="row"><span class="spring" /><${Select} value=${what} options=${[["moved", "moved mm"], ["turned", "turned °"], ["force", "forces N"]]} onChange=${setWhat} /></div>
      <${Chart} key=${what} series=${series} x=${x} xLabel="step" yLabel=${what} units=${{ moved: "mm", turned: "°", force: "N" }[what]} span=${1} digits=${1} cursor=${shown} onSeek=${(k) => showMoment(Math.max(0, Math.min(path.n - 1, k)))} height=${9} />`}
    ${shown > 0 && html`<${Table} rows=${contacts} columns=${columnsOf(contacts, [
      { title: `touches at step ${shown}`, left: true, of: (c) => c.name },
      { title: "points", of: (c) => c.n },
      { title: "force N", of: (c) => number(c.force_n, 1) },
      { title: "depth mm", hint: "penetration, positive: overlapping", of: (c) => number(c.depth_mm, 2) },
    ])} />${contacts.length === 0 && html`<p class="dim">${path.has_contacts
      ? `It touches nothing at step ${shown}.` : "This simulator gives no contacts."}</p>`}`}`;
}

/** @param {{ answer: PhysicsAnswer, moment: Moment }} props */
function Scene({ answer, moment }) {
  const objects = useStore((s) => s.frame.objects);
  const of = (id) => objects.find((o) => o.id === id) ?? { label: `object ${id}`, color: "#888" };
  if (answer.objects.length < 2 && !answer.overlaps.length) return null;
  const columns = columnsOf(answer.objects, [
    { title: "object", left: true, of: (o) => html`<${Light} tone=${o.tone} /><${Swatch} color=${of(o.obj).color} />${of(o.obj).label}` },
    { title: "gap mm", of: (o) => number(o.gap_mm, 1) },
    { title: "overlap mm", of: (o) => (o.into ? number(o.depth_mm, 1) : "–") },
    { title: "balance mm", hint: "centre of mass to the edge of its support", of: (o) => number(o.margin_mm, 1) },
  ]);
  return html`${answer.objects.length > 1 && html`<h3>All objects, among each other</h3>
      <${Table} columns=${columns} rows=${answer.objects} keyOf=${(o) => o.obj} current=${(o) => o.obj === moment.obj} onRow=${(o) => setView({ obj: o.obj, arm: null })} />
      ${answer.objects.filter((o) => o.tone === "red" || o.tone === "amber").map((o) => html`<p class=${`light-words ${o.tone}`}><b>${of(o.obj).label}</b> ${o.words}</p>`)}`}
    ${answer.overlaps.length > 0 && html`<h3>Overlaps</h3>${answer.overlaps.map((o) => html`<p><${Swatch} color=${of(o.first).color} />${of(o.first).label} lies up to <b>${number(o.depth_mm, 1)} mm</b> in <${Swatch} color=${of(o.second).color} />${of(o.second).label}</p>`)}`}`;
}

/** @param {{ around: SupportAround | null, branch: number }} props */
function Around({ around, branch }) {
  if (!around) return null;
  const observed = around.source !== "plane";
  const { plane } = around;
  const restart = (support) => send({ verb: "restart", branch, changes: { "physics.support": support } });
  const hull = settingsOf(state).some((one) => one.name === "physics.collider" && one.value === "hull");
  return html`<h3>What supports them</h3>
    <dl class="facts"><div title="share of the background that lies on the support plane; the rest is what else is in view"><dt>plane explains</dt><dd>${number(100 * plane.share, 0)} %</dd></div>
      <div title="root mean square distance of the points on it"><dt>scatter</dt><dd>${number(plane.rms_mm, 1)} mm</dd></div>
      <div title="angle between the plane's normal and up"><dt>tilt against gravity</dt><dd>${number(plane.tilt_deg, 1)}°</dd></div></dl>
    ${observed && html`<p>${around.source === "observed" ? "The depth image" : "The mesh"} shows ${around.surfaces} surface${around.surfaces === 1 ? "" : "s"} and ${around.solids} other solid${around.solids === 1 ? "" : "s"}.</p>`}
    ${around.unknown.map((one) => html`<div class="row" key=${one.number}><span>Unknown object ${one.number}, ${one.size_mm.map((x) => x.toFixed(0)).join(" × ")} mm${one.dropped ? html`<span class="dim">, dropped</span>` : ""}</span><span class="spring" />
      <${Button} engine title=${one.dropped ? "let it stop objects again; restarts the run" : "let it stop nothing; restarts the run"}
        onClick=${() => send({ verb: "order", branch, drop: [one.number, !one.dropped] })}>${one.dropped ? "Restore" : "Drop"}<//></div>`)}
    <div class="row"><${Button} engine title="restarts the run" onClick=${() => restart(observed ? "plane" : "observed")}>${observed ? "Use the plane alone" : "Use what the depth image shows"}<//>
      ${hull && html`<${Button} engine title="physics takes every model for its convex hull now; restarts the run"
        onClick=${() => send({ verb: "restart", branch, changes: { "physics.collider": "decomposition" } })}>Use convex parts<//>`}</div>`;
}
