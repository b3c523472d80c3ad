// One table of keys, the same for buttons' titles, the help and the palette; keys work whatever was clicked last.
import { html } from "htm/preact";
import { useState, useRef, useEffect } from "preact/hooks";
import { state, setView, update, send, useStore } from "./store.js";
import { runOf } from "./moment.js";
import { back, isBusy, pause, seek, step, stepStage, stopReplay, toggleRun, toNextEvent } from "./cursor.js";
import { Dialog, fillPane } from "./ui.js";
import { tabs, idOf } from "./tabs/all.js";
import { setPreset, presets, switchTheme } from "./layout.js";
import { closeDoubt } from "./doubts.js";
import { copyLink } from "./address.js";
import { isLabelling } from "./labelling.js";

// when: whether it can be done now; silent: not in the lists. The first key is the one that titles name.
export const ACTIONS = [
  { id: "back", keys: ["ArrowLeft", "b"], title: "Back", group: "Move", action: back },
  { id: "step", keys: ["ArrowRight", "n"], title: "Step", group: "Move", action: step },
  { id: "stage", keys: ["s"], title: "Next stage of the iteration", group: "Move", action: stepStage },
  { id: "run", keys: [" "], title: "Run or pause", group: "Move", action: toggleRun },
  { id: "event", keys: ["e"], title: "To the next event", group: "Move", action: () => toNextEvent(1) },
  { id: "event-back", keys: ["E"], title: "To the event before", group: "Move", action: () => toNextEvent(-1) },
  { id: "start", keys: ["Home"], title: "To the start", group: "Move", action: () => seek(0) },
  { id: "end", keys: ["End"], title: "To the end", group: "Move", action: () => seek(runOf(state).rows.length) },
  { id: "frame", keys: ["]"], title: "Next frame", group: "Move", when: () => frameBeside(1), action: () => openBeside(1) },
  { id: "frame-back", keys: ["["], title: "Frame before", group: "Move", when: () => frameBeside(-1),
    action: () => openBeside(-1) },
  { id: "gallery", keys: ["g"], title: "Gallery", group: "Show", action: toggleGallery },
  { id: "fill", keys: ["f"], title: "Fill the middle with a pane, or all panes", group: "Show", action: toggleFull },
  { id: "theme", keys: ["d"], title: "Light or dark", group: "Show", action: switchTheme },
  { id: "link", keys: [], title: "Copy the link", group: "Show", action: copyLink },
  { id: "help", keys: ["?"], title: "All keys", group: "Show", action: () => toggleOverlay("help") },
  { id: "palette", keys: ["Ctrl+k"], title: "All by name", group: "Show", action: () => toggleOverlay("palette") },
  { id: "escape", keys: ["Escape"], title: "Close, unmark, cancel", group: "Show", action: escape },
];

const NAMES = { ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", " ": "Space", Escape: "Esc" };
export const keyName = (key) => key.replace(/^((?:Ctrl\+)?(?:Shift\+)?)(.+)$/, (_, held, last) => held + (NAMES[last]
  ?? (/^[A-Z]$/.test(last) ? `Shift+${last}` : last.length === 1 ? last.toUpperCase() : last)));
// A button's title: what it does and its key.
export function titled(id, words) {
  const action = ACTIONS.find((a) => a.id === id);
  return `${words ?? action.title}${action.keys.length ? ` (${keyName(action.keys[0])})` : ""}`;
}

// More actions, of panes: returns what takes them away again. { id, keys, title, group, action, when }; `action` gets the
// key's event. They go before others of their keys while they can be done.
export function addKeys(actions) {
  ACTIONS.unshift(...actions);
  return () => actions.forEach((a) => ACTIONS.includes(a) && ACTIONS.splice(ACTIONS.indexOf(a), 1));
}

const frameBeside = (by) => {
  const frames = state.frame?.frames ?? [];
  return frames[frames.indexOf(state.frame?.frame) + by];
};
const openBeside = (by) => send({ verb: "open", frame: frameBeside(by) });

// The name of a scene that shows a failure gives the diagnosis away.
const isFailure = (name) => /^failure_/.test(name);
export const nameToOpen = (name, names) => (isFailure(name)
  ? `What went wrong? ${names.filter(isFailure).indexOf(name) + 1}` : name);

function toggleGallery() {
  setPreset(state.view.preset === "gallery" ? "inspect" : "gallery");
}
function toggleFull() {
  fillPane(state.view.full ?? state.lastPane ?? "image");
}
function toggleOverlay(name) {
  update({ overlay: state.overlay === name ? null : name });
}

function escape() {
  if (state.overlay) return update({ overlay: null });
  if (state.toasts.length) return update({ toasts: [] });
  if (state.busy.text && state.busy.cancel) return send({ verb: "cancel" });
  if (state.replaying) return stopReplay();
  if (state.view.edited) return setView({ edited: null });
  if (state.view.model != null) return setView({ model: null });
  if (state.view.doubt != null) return closeDoubt();
  if (state.view.largeMap) return setView({ largeMap: null });
  if (state.view.pixel || state.view.ruler) return setView({ pixel: null, ruler: null });
  if (state.view.measuring) return setView({ measuring: false });
  if (state.view.full) return setView({ full: null });
  if (state.view.stage) return setView({ stage: null, moment: null });
  if (state.view.obj != null && !isLabelling(state)) return setView({ obj: null, arm: null }); // a label stays in hand
  if (isBusy()) pause();
  else if (state.report) setPreset("report");
  return undefined;
}

const NO_TEXT = ["checkbox", "radio", "range", "button"].map((type) => `[type=${type}]`).join();
const isText = (e) => e?.matches?.(`textarea, select, [contenteditable], input:not(${NO_TEXT})`);
// Esc, too, but in a dialog, which it closes.
const isOfField = (e) => isText(e.target) && (e.key !== "Escape" || !state.overlay);

/**
 * What a key does: of several actions the first that can be done now.
 * @returns {{ action: (event: KeyboardEvent) => void, when?: () => unknown } | undefined}
 */
function actionOf(key) {
  const all = ACTIONS.filter((a) => a.keys.includes(key));
  const tab = /^[1-9]$/.test(key) ? tabs[key - 1] : null;
  return all.find((a) => !a.when || a.when()) ?? all[0] ?? (tab && { action: () => setView({ tab: idOf(tab) }) });
}

function pressed(event) {
  if (event.defaultPrevented || event.isComposing) return;
  if (isOfField(event)) return;
  const ctrl = event.ctrlKey || event.metaKey;
  if (event.altKey) return;
  const plain = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const key = ctrl ? `Ctrl+${event.shiftKey ? "Shift+" : ""}${plain}` : event.key;
  if (state.overlay && !["Escape", "?"].includes(key)) return;
  const action = actionOf(key) ?? (event.shiftKey || ctrl ? null : actionOf(key.toLowerCase()));
  if (!action) return;
  event.preventDefault(); // also what a focused button or the page would do with it
  event.stopPropagation();
  if (event.key === "Escape") event.target.blur?.();
  if (!action.when || action.when()) action.action(event);
}

// Listens in a window: this one, and that of the 3D pane.
export function attachKeys(target) {
  target.addEventListener("keydown", pressed, true);
  // Esc leaves a field and does no more; the field itself hears it first.
  target.addEventListener("keydown", (e) => e.key === "Escape" && isText(e.target) && e.target.blur());
  // A button that has the focus all the same would be pressed when Space is let go.
  target.addEventListener("keyup", (e) => e.key === " " && !isText(e.target) && e.preventDefault(), true);
}

export function Overlay() {
  const overlay = useStore((s) => s.overlay);
  const close = () => update({ overlay: null });
  if (overlay === "help") return html`<${Help} onClose=${close} />`;
  if (overlay === "palette") return html`<${Palette} onClose=${close} />`;
  return null;
}

// The keys of an action that no other takes at all times.
const keysLeft = (a, all) => a.keys.filter((key) =>
  all.slice(0, all.indexOf(a)).every((before) => before.when || !before.keys.includes(key)));

function Help({ onClose }) {
  const names = tabs.slice(0, 9).map((t) => t.title).join(", ");
  /** @type {any[]} */
  const every = [...ACTIONS, { keys: ["1"], shown: "1 – 9", title: `Tabs ${names}`, group: "Show" }];
  const all = every.map((a) => ({ ...a, keys: keysLeft(a, every) }))
    .filter((a) => a.keys.length && !a.silent && (!state.file || !a.when || a.when()));
  const groups = [...new Set(all.map((a) => a.group))].sort((one, other) => Number(other === "Label") - Number(one === "Label"));
  return html`<${Dialog} title="Keys" onClose=${onClose} wide>
    <div class="keys">${groups.map((group) => html`<section><h3>${group}</h3><dl>
      ${all.filter((a) => a.group === group).map((a) => html`
        <div><dt>${(a.shown ? [a.shown] : a.keys.map(keyName)).map((k) => html`<kbd>${k}</kbd>`)}</dt>
          <dd>${a.title}</dd></div>`)}
    </dl></section>`)}</div>
    <p class="dim">Drag on the timeline to move through the run. Double click a pane's title to fill the middle.</p>
  <//>`;
}

function everything() {
  const items = ACTIONS.filter((a) => a.id !== "palette" && !a.silent && (!a.when || a.when()))
    .map((a) => ({ kind: a.group, words: a.title, key: a.keys[0] && keyName(a.keys[0]), action: a.action }));
  const add = (kind, words, action, key = "") => items.push({ kind, words, action, key });
  for (const preset of presets(state)) add("Preset", preset.title, () => setPreset(preset.id));
  for (const o of state.frame?.objects ?? []) add("Object", o.label, () => setView({ obj: o.id, arm: null }));
  tabs.forEach((t, i) => add("Tab", t.title, () => setView({ tab: idOf(t) }), i < 9 ? String(i + 1) : ""));
  for (const { index, name } of state.branches) {
    add("Branch", name, () => setView({ branch: index, k: runOf(state, index).rows.length, stage: null }));
  }
  for (const f of state.frame?.frames ?? []) add("Frame", f, () => send({ verb: "open", frame: f }));
  const demos = state.frame?.demos ?? [];
  for (const d of demos) add("Demo", nameToOpen(d, demos), () => send({ verb: "open", demo: d }));
  return items;
}

const MOST = 60;
function Palette({ onClose }) {
  const [text, setText] = useState("");
  const [at, setAt] = useState(0);
  const input = useRef(null);
  const list = useRef(null);
  useEffect(() => input.current.focus(), []);
  useEffect(() => list.current.querySelector(".current")?.scrollIntoView({ block: "nearest" }), [at]);
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  const fits = (item) => words.every((w) => `${item.kind} ${item.words}`.toLowerCase().includes(w));
  const items = everything().filter(fits).slice(0, MOST);
  const take = (item) => {
    onClose();
    item?.action();
  };
  const down = (e) => {
    const move = { ArrowDown: 1, ArrowUp: -1 }[e.key];
    if (move) {
      e.preventDefault();
      setAt((at + move + items.length) % Math.max(items.length, 1));
    } else if (e.key === "Enter") take(items[at]);
  };
  return html`<${Dialog} onClose=${onClose}>
    <input class="palette" ref=${input} placeholder="Type what to do or to show" value=${text} spellcheck=${false}
      onInput=${(e) => { setText(e.currentTarget.value); setAt(0); }} onKeyDown=${down} />
    <ul class="choices" ref=${list}>${items.map((item, i) => html`
      <li class=${i === at ? "current" : ""} onPointerMove=${() => i !== at && setAt(i)} onClick=${() => take(item)}>
        <span class="dim">${item.kind}</span><span>${item.words}</span>${item.key && html`<kbd>${item.key}</kbd>`}
      </li>`)}
      ${items.length === 0 && html`<li class="dim nothing">nothing by that name</li>`}
    </ul>
  <//>`;
}
