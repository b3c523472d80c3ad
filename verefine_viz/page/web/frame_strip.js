// The frames of a session that is no batch, as small pictures: a strip over the timeline, and cards in place of a gallery.
import { html } from "htm/preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import { addressOf, send, state, useStore } from "./store.js";
import { counted, IconButton, Light } from "./ui.js";
import { titled } from "./keys.js";
import { presets, setPreset } from "./layout.js";
import { Sequence, Switch } from "./sequence.js";

const MOST = 60; // frames to either side of the open one that are in the page

/** @param {import("./store.js").State} s */
export const hasStrip = (s) => !s.file && !s.answers && (s.frame?.frames.length ?? 0) > 1;
/** @param {string} frame */
function open(frame) {
  if (state.view.preset === "gallery") setPreset(presets(state).find(({ id }) => ["label", "inspect"].includes(id)).id);
  if (frame !== state.frame.frame) send({ verb: "open", frame });
}

/**
 * A frame's picture; it is asked for where it is seen, and while nothing takes long.
 * @param {{ i: number }} props
 */
function FrameCell({ i }) {
  const [frame, isBusy, made] = useStore((s) =>
    [s.frame, Boolean(s.busy.text) || s.running.branch != null, s.labels?.frames[s.frame.frames[i]]]);
  const asked = useRef(false);
  asked.current ||= !isBusy;
  const name = frame.frames[i];
  const address = addressOf(`/frame/${i}?${encodeURIComponent(`${frame.dataset} ${name}`)}`);
  return html`<button type="button" class=${`frame-cell ${name === frame.frame ? "current" : ""}`} title=${`frame ${name}`}
    onClick=${(e) => { e.currentTarget.blur(); open(name); }}>
    ${asked.current ? html`<img src=${address} alt="" loading="lazy" draggable=${false} />` : html`<i />`}<span>${name}</span>
    ${made?.labels > 0 && html`<b class="made" title=${`${counted(made.labels, "label")}, ${made.accepted} accepted, ${made.undecided} to look at`}>
      ${(made.undecided > 0 || made.accepted === made.labels) && html`<${Light} tone=${made.light} />`}${made.labels}</b>`}</button>`;
}

export function FrameStrip() {
  const frame = useStore((s) => (hasStrip(s) && s.view.preset !== "gallery" ? s.frame : null)); // there all of them are
  const host = useRef(null);
  const at = frame ? frame.frames.indexOf(frame.frame) : -1;
  useLayoutEffect(() => {
    const current = host.current?.querySelector(".current");
    if (current) host.current.scrollLeft = current.offsetLeft - (host.current.clientWidth - current.offsetWidth) / 2;
  }, [at, frame?.dataset]);
  if (!frame) return null;
  const first = Math.max(0, at - MOST);
  const shown = frame.frames.slice(first, at + MOST + 1);
  const n = frame.frames.length;
  return html`<div class="frame-strip">
    <${IconButton} icon="back" title=${titled("frame-back")} disabled=${at <= 0} onClick=${() => open(frame.frames[at - 1])} />
    <div class="cells" ref=${host}>${shown.map((name, i) => html`<${FrameCell} key=${name} i=${first + i} />`)}</div>
    <${IconButton} icon="step" title=${titled("frame")} disabled=${at >= n - 1} onClick=${() => open(frame.frames[at + 1])} />
    <span class="dim">${at + 1} of ${n}</span></div>`;
}

const MOST_CARDS = 400;
export function FrameCards() {
  const [frame, isSequence] = useStore((s) => [s.frame, s.sequence.on]);
  const { frames } = frame;
  return html`<header class="gallery-bar"><${Switch} /><h2>${frames.length} frames</h2><span class="dim"><kbd>verefine-viz batch</kbd> solves them all.</span></header>
    ${isSequence ? html`<${Sequence} />` : html`<div class="frame-cards scroll">${frames.slice(0, MOST_CARDS).map((name, i) => html`<${FrameCell} key=${name} i=${i} />`)}
      ${frames.length > MOST_CARDS && html`<p class="dim">and ${frames.length - MOST_CARDS} more</p>`}</div>`}`;
}
