// The page: one grid of panes.
import { html } from "htm/preact";
import { Component, render } from "preact";
import { state, useStore, setView, send, changed } from "./store.js";
import "./received.js";
import { followAddress } from "./address.js";
import { dismiss } from "./toasts.js";
import { connect } from "./connection.js";
import { isFile, openFile } from "./file.js";
import { applyTheme, isLarge, setSize, sizesOf } from "./layout.js";
import { attachKeys, Overlay } from "./keys.js";
import { momentOf } from "./moment.js";
import { Button, counted, IconButton, Icon, Menu, Pane, Splitter, Tabs } from "./ui.js";
import { Verdict } from "./verdict.js";
import { Objects } from "./objects.js";
import { Film } from "./film.js";
import { Timeline } from "./timeline.js";
import { ImagePane } from "./image.js";
import { MapsPane } from "./maps.js";
import { ScenePane } from "./scene.js";
import { Gallery } from "./gallery.js";
import { FrameStrip } from "./frame_strip.js";
import { Labels } from "./labels.js";
import { Report } from "./report.js";
import { tabs, idOf } from "./tabs/all.js";

/** @import { BranchListed, BusyMessage } from "./messages.d.ts" */

const fr = (share) => `minmax(0, ${share}fr)`;
// The film stands above the timeline, in a file above all.
const rowsOf = (size) => {
  const panes = `${fr(1 - size.maps - size.timeline)} 1px ${fr(size.maps)} 1px`;
  return `auto ${isFile ? `auto ${panes}` : `${panes} auto`} ${fr(size.timeline)} auto`;
};
const kindOfFile = () => (isFile ? `is-file ${state.file?.scene ? "" : "no-scene"}` : "");

function Page() {
  const [preset, full, frame, connection, busy, report] = useStore((s) =>
    [s.view.preset, s.view.full, s.frame, s.connection, s.busy, s.report, s.sizes, isLarge()]);
  const size = sizesOf(state);
  const [gallery, labels] = ["gallery", "label"].map((id) => preset === id);
  const grid = {
    gridTemplateColumns: `${fr(size.image)} 1px ${fr(1 - size.image)} 1px minmax(0, ${100 * size.inspector}vw)`,
    gridTemplateRows: labels ? `auto ${fr(1)} 0 0 0 0 auto auto` : rowsOf(size),
  };
  const classes = `page ${kindOfFile()} ${labels ? "labels" : ""} ${gallery ? `shows-gallery ${frame ? "" : "alone"}` : full ? `full full-${full}` : ""}`;
  // The 3D pane stays where it is in every layout: taken out, it would be loaded again.
  return html`<div class=${classes} style=${grid}>
    <${Verdict} />
    <${Film} />
    <${Guard} name="image"><${ImagePane} /><//>
    <${Splitter} axis="x" area="split-image" share=${size.image * (1 - size.inspector)}
      onShare=${(x) => setSize("image", x / (1 - size.inspector))} />
    <${Guard} name="scene"><${ScenePane} /><//>
    <${Splitter} axis="y" area="split-maps" share=${size.maps} invert onShare=${(x) => setSize("maps", x)} />
    <${Guard} name="maps"><${MapsPane} /><//>
    ${preset === "report" && html`<main class="pane report scroll"><${Guard}><${Report} /><//></main>`}
    ${gallery && html`<section class="pane gallery"><${Guard}><${Gallery} /><//></section>`}
    <${Splitter} axis="y" area="split-timeline" share=${size.timeline} invert
      onShare=${(x) => setSize("timeline", x)} />
    ${labels ? html`<section class="timeline"><${FrameStrip} /></section>` : html`<${Timeline} />`}
    <${Splitter} axis="x" area="split-inspector" share=${size.inspector} invert
      onShare=${(x) => setSize("inspector", x)} />
    <aside class="inspector">${labels ? html`<${Guard}><${Labels} /><//>` : html`<${Objects} /><${Inspector} />`}</aside>
    <${Status} />
    <${Toasts} />
    <${Overlay} />
    ${!frame && !report && html`<div class="veil opening">
      ${busy.picture && html`<img src=${`/blob/${busy.picture}`} alt="" />`}
      <p>${connection === "lost" ? "The server does not answer." : busy.text || "Opening"}</p>
      ${connection !== "lost" && busy.text && html`<${Meter} share=${busy.share} /><div
        class="group"><${BusyButtons} busy=${busy} /></div>`}</div>`}
  </div>`;
}

// A pane that fails says so and leaves the others alone.

class Guard extends Component {
  componentDidCatch(error) {
    console.error(error);
    this.setState({ error });
  }
  render({ children, name }, { error }) {
    if (!error) return children;
    const words = html`<div class="empty"><p>It cannot be drawn: ${String(error.message ?? error)}</p>
      <${Button} title="try once more" onClick=${() => this.setState({ error: null })}>Draw it again<//></div>`;
    return name ? html`<${Pane} name=${name} title=${name}>${words}<//>` : words;
  }
}

// The tab that is shown: the one chosen, else the one with the picture of what went wrong.
/** @param {import("./store.js").State} s */
function tabAt(s) {
  const moment = momentOf(s);
  const finding = moment?.isAnswer && moment.verdict?.tone === "wrong" ? moment.verdict.findings[0] : null;
  return s.view.tab ?? (s.frame?.method === "trace" ? "trace" : finding?.tab || "score");
}

function Inspector() {
  const [tab, lacking] = useStore(
    (s) => [tabAt(s), momentOf(s) ? tabs.filter((t) => t.needs && !t.needs(s)).map(idOf).join() : ""]);
  useStore((s) => s.view); // `needs` may look at all of it
  const empty = new Set(lacking.split(","));
  const current = tabs.find((t) => idOf(t) === tab) ?? tabs[0];
  const id = idOf(current);
  const list = tabs.map((t, i) => {
    return { id: idOf(t), title: t.title, dim: empty.has(idOf(t)), hint: t.hint ?? t.title, shortcut: i < 9 ? i + 1 : "" };
  });
  const why = typeof current.empty === "function" ? current.empty(state) : current.empty;
  return html`<${Tabs} tabs=${list} value=${id} onChange=${(value) => setView({ tab: value })} />
    <div class="tab-content scroll" key=${id}>${!momentOf(state) ? state.frame && html`<p class="empty">This frame has no object yet.</p>`
      : empty.has(id) ? html`<p class="empty">${why}</p>` : html`<${Guard}><${current.render} /><//>`}</div>`;
}

// A line that is always there: what is computed, or that the server is lost.
function Status() {
  const [busy, connection, running, branches, branch, frame] = useStore((s) =>
    [s.busy, s.connection, s.running, s.branches, s.view.branch, s.frame]);
  const shown = branches.find((b) => b.index === branch);
  return html`<footer class=${`status ${connection === "lost" ? "lost" : ""}`}>
    <span class="doing">${connection === "lost" ? html`<${Icon}
      name="warn" />The server does not answer; it is tried again every second.`
      : !frame ? "" // the middle of the page says it
      : busy.text ? html`<${Meter} share=${busy.share} /><span>${busy.text}</span><${BusyButtons} busy=${busy} />`
      : running.branch != null ? html`<${Meter} /><span>Computing</span>`
      : running.stopped ? html`<span class="stopped">${running.stopped}</span>` : ""}</span>
    <span class="spring" />
    ${branches.length > 1 && html`<span class="branches">${branches.map((b) => html`<${BranchButton} key=${b.index}
      branch=${b} on=${b.index === branch} />`)}</span>`}
    <${Notes} />
    ${state.file ? html`<span class="dim" title=${`open it in the program: ${state.file.command}`}>file</span>`
      : shown?.recording && html`<span class="dim" title=${shown.recording}>recording</span>`}
  </footer>`;
}

const Meter = ({ share }) => html`<span class="meter"><i class=${share == null ? "unknown" : ""}
  style=${{ width: share == null ? "30%" : `${100 * share}%` }} /></span>`;

/** @param {{ busy: BusyMessage }} props */
const BusyButtons = ({ busy }) => html`
  ${busy.hulls && html`<${Button} title="physics takes every model for its convex hull: no waiting"
    onClick=${() => send({ verb: "open", hulls: true })}>Start with hulls<//>`}
  ${busy.cancel && html`<${Button} title="everything stays as it was (Esc)"
    onClick=${() => send({ verb: "cancel" })}>Cancel<//>`}`;

// What is worth knowing of the frame's data; doubts about them have badges beside the verdict.
function Notes() {
  const frame = useStore((s) => s.frame);
  const notes = frame?.notes ?? [];
  if (!notes.length) return null;
  return html`<${Menu} align="right" title="Notes on the data of this frame"
    label=${counted(notes.length, "note")}><div
      class="notes">${notes.map((n) => html`<p>${n}</p>`)}</div><//>`;
}

/** @param {{ branch: BranchListed, on: boolean }} props */
function BranchButton({ branch, on }) {
  const run = useStore((s) => s.runs.get(branch.index));
  const done = run?.rows.length ?? 0;
  const parent = state.branches.find((b) => b.index === branch.parent);
  const left = parent ? `; it left ${parent.name} after iteration ${branch.from}` : "";
  const show = () => setView({ branch: branch.index, k: Math.min(state.view.k, done) || done, stage: null,
    moment: null, arm: null, edited: null });
  return html`<${Button} on=${on} onClick=${show}
    title=${`${branch.name}: ${done} of ${run?.total ?? 0} iterations${left}`}>
    ${branch.name}<span class="dim">${done}/${run?.total ?? 0}</span><//>`;
}

function Toasts() {
  const toasts = useStore((s) => s.toasts);
  return html`<div class="toasts" aria-live="polite">${toasts.map((t) => html`
    <div key=${t.id} class=${`toast ${t.kind}`}><span>${t.text}</span>
      ${t.url && html`<a href=${t.url} download=${t.name}>download</a>`}
      ${t.offer && html`<${Button} title="do this instead"
        onClick=${() => { dismiss(t.id); "action" in t.offer ? t.offer.action() : send(t.offer.verb); }}>${t.offer.words}<//>`}
      <${IconButton} icon="close" title="close" onClick=${() => dismiss(t.id)} />
    </div>`)}</div>`;
}

applyTheme();
attachKeys(window);
addEventListener("resize", changed);
render(html`<${Page} />`, document.getElementById("app"));
followAddress();
if (isFile) openFile();
else connect();
