// What is open and where it came from; saving it and what was worked out.
import { html } from "htm/preact";
import { useState } from "preact/hooks";
import { send, setView, useStore } from "../store.js";
import { editWords, momentOf } from "../moment.js";
import { seek } from "../cursor.js";
import { savedMaps } from "../wants.js";
import { Button, Toggle } from "../ui.js";
import { listOf } from "./setting.js";

/** @import { BranchListed, FrameObject, Save } from "../messages.d.ts" */

export const title = "Session";
export const hint = "what is open; saving and exporting it";
export const needs = (/** @type {import("../store.js").State} */ s) => Boolean(s.frame);
export const empty = "Nothing is open.";

/** @type {[Save["what"], string, string][]} */
const FILES = [
  ["recording", "Recording", "the run of this branch, for replay and for rerun"],
  ["share", "Page", "this page as one HTML file that opens offline, without the program"],
  ["results", "Results", "the answers as a table (CSV)"],
  ["maps", "Score maps", "the score maps of the object in focus (PNG)"],
  ["verbs", "Verb log", "what was done here; carried out again it gives the same records"],
];

export function render() {
  const [frame, branches, branch, written, version] = useStore((s) => [s.frame, s.branches, s.view.branch, s.written, s.version]);
  const moment = useStore(momentOf);
  const [name, setName] = useState("my_session");
  const [replace, setReplace] = useState(false);
  const draft = useStore((s) => s.draft) ?? {};
  const waiting = Object.keys(draft);
  const shown = branches.find((b) => b.index === branch);
  /** @type {(what: Save["what"], more?: Pick<Save, "poses" | "name" | "replace">) => boolean} */
  const save = (what, more = {}) => send({ verb: "save", what, branch, k: moment.k, obj: moment.obj, ...more });
  const facts = [
    ["scene", frame.dataset && !/^failure_/.test(frame.dataset) ? `${frame.source}: ${frame.dataset}` : frame.source],
    ["frame", `${frame.frame}${frame.frames.length > 1 ? `, one of ${frame.frames.length}` : ""}`],
    ["method", `${frame.method_label}, refiner ${frame.refiner}`],
    ["session file", frame.session_file ?? "none: it was not read from a file"],
    ["recording", shown?.recording],
    ["branch", shown && `${shown.name}${Object.keys(shown.settings).length ? `: ${listOf(shown.settings)}` : ""}`],
    ["version", version],
  ].filter(([, value]) => value);
  return html`<div class="tab session">
    <table class="table"><tbody>${facts.map(([key, value]) => html`<tr><td class="left dim">${key}</td><td class="left path">${value}</td></tr>`)}</tbody></table>
    ${frame.doubts.length > 0 && html`<h3>The data are in doubt</h3>${frame.doubts.map((d) => html`<p class="doubt">${d.text}.</p>`)}`}
    ${frame.notes.length > 0 && html`<h3>Notes on this frame</h3>${frame.notes.map((n) => html`<p>${n}</p>`)}`}
    ${shown?.missing && html`<p class="doubt">${shown.missing}</p>`}
    ${moment.run.notes.map((n) => html`<p class="doubt">${n[0].toUpperCase() + n.slice(1)}.</p>`)}
    ${shown && html`<${Beside} branch=${shown} objects=${frame.objects} />`}
    <h3>Save the session</h3>
    <div class="row"><input type="text" class="name" value=${name} title="written to sessions/NAME.toml: settings, breakpoints, changes and edited poses" onInput=${(e) => setName(e.currentTarget.value)} />
      <${Button} engine kind="primary" title="write the session file" disabled=${!name.trim()} onClick=${() => save("session", { name: name.trim(), replace })}>Save<//>
      <${Toggle} value=${replace} title="write over a file of that name" onChange=${setReplace}>replace<//></div>
    ${waiting.length > 0 && html`<p class="dim">Not saved, as it is not in use yet: ${listOf(draft)}.</p>`}
    <h3>Export</h3>
    <div class="row">${FILES.map(([what, words, hint]) => html`<${Button} engine key=${what} title=${hint} onClick=${() => save(what, what === "maps" ? { poses: savedMaps(moment) } : {})}>${words}<//>`)}</div>
    ${written.length > 0 && html`<h3>Written</h3>${written.map((file) => html`<p class="path" key=${file.url}>${file.url ? html`<a href=${file.url} download=${file.name}>${file.name}</a> ` : ""}<span class="dim">${file.path}</span></p>`)}`}
  </div>`;
}

/**
 * What the branch does beside its method: poses that were edited, settings that change on the way.
 * @param {{ branch: BranchListed, objects: FrameObject[] }} props
 */
function Beside({ branch, objects }) {
  const when = (/** @type {number} */ k) => (k ? `after iteration ${k}` : "before iteration 1");
  return html`${branch.edits.length > 0 && html`<h3>Edited poses</h3>
      ${branch.edits.map((edit) => html`<p><button type="button" class="link" title="show it" onClick=${() => { setView({ obj: edit.obj, arm: edit.arm }); seek(edit.k); }}>${
        editWords(edit, objects)}</button> ${when(edit.k)}</p>`)}`}
    ${branch.changes.length > 0 && html`<h3>Settings that change on the way</h3>
      ${branch.changes.map((change) => html`<p>${when(change.k)}: ${listOf(change.settings)}</p>`)}`}
    ${branch.elsewhere.length > 0 && html`<p class="dim">The session also edits ${branch.elsewhere.join("; ")}.</p>`}`;
}
