// A small kit: what several panes need of buttons, menus, tables and icons.
import { html } from "htm/preact";
import { useState, useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { useStore, setView, state } from "./store.js";
import { toast } from "./toasts.js";

// Icons are 16×16 outlines, drawn in the colour of the text.
const ICONS = {
  back: ["M10 3.5 5 8l5 4.5"],
  step: ["M6 3.5 11 8l-5 4.5"],
  stage: ["M3.5 3.5 7 8l-3.5 4.5", "M9.5 4v8", "M12.5 4v8"],
  run: ["M4.5 3v10l8-5z"],
  pause: ["M5 3.5v9", "M11 3.5v9"],
  event: ["M3 4 7.5 8 3 12z", "M9 4l4.5 4L9 12z"],
  prevEvent: ["M13 4 8.5 8l4.5 4z", "M7 4 2.5 8 7 12z"],
  chain: ["M7 9.5a3 3 0 0 0 4.2 0l2-2a3 3 0 0 0-4.2-4.2l-1 1", "M9 6.5a3 3 0 0 0-4.2 0l-2 2a3 3 0 0 0 4.2 4.2l1-1"],
  sun: ["M8 5a3 3 0 1 0 0 6 3 3 0 0 0 0-6z",
    "M8 1v1.5M8 13.5V15M1 8h1.5M13.5 8H15M3 3l1 1M12 12l1 1M13 3l-1 1M4 12l-1 1"],
  moon: ["M13 9.6A5.5 5.5 0 0 1 6.4 3 5.5 5.5 0 1 0 13 9.6z"],
  help: ["M6 6a2 2 0 1 1 2.6 1.9c-.5.2-.6.6-.6 1.3", "M8 11.6v.4"],
  fill: ["M2.5 6V2.5H6M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10"],
  shrink: ["M6 2.5V6H2.5M13.5 6H10V2.5M10 13.5V10h3.5M2.5 10H6v3.5"],
  down: ["M4 6.5 8 10.5l4-4"],
  up: ["M4 10.5 8 6.5l4 4"],
  undo: ["M6 3 3 6l3 3", "M3 6h6.5a3.5 3.5 0 0 1 0 7H6"],
  close: ["M4 4l8 8M12 4l-8 8"],
  more: ["M3.5 8h.01M8 8h.01M12.5 8h.01"],
  check: ["M3 8.5 6.5 12 13 4.5"],
  cross: ["M4 4l8 8M12 4l-8 8"],
  eye: ["M1.5 8s2.5-4.5 6.5-4.5S14.5 8 14.5 8s-2.5 4.5-6.5 4.5S1.5 8 1.5 8z", "M8 6.2a1.8 1.8 0 1 0 0 3.6 1.8 1.8 0 0 0 0-3.6z"],
  question: ["M5.5 5.5a2.5 2.5 0 1 1 3.4 2.3c-.7.3-.9.8-.9 1.6", "M8 12.2v.3"],
  warn: ["M8 2 14.5 13.5h-13z", "M8 6.5v3M8 11.6v.2"],
  dot: ["M8 6a2 2 0 1 0 0 4 2 2 0 0 0 0-4z"],
  stop: ["M5.5 2h5L14 5.5v5L10.5 14h-5L2 10.5v-5z"],
  search: ["M7 2.5a4.5 4.5 0 1 0 0 9 4.5 4.5 0 0 0 0-9z", "M10.3 10.3 14 14"],
  share: ["M8 10V2.5M5 5.2 8 2.2l3 3", "M4.5 7.5H3v6h10v-6h-1.5"],
  redo: ["M10 3l3 3-3 3", "M13 6H6.5a3.5 3.5 0 0 0 0 7H10"],
  folder: ["M2 3.5h4.2l1.5 2H14v7H2z"],
  list: ["M6 4h8M6 8h8M6 12h8M2.5 4h.01M2.5 8h.01M2.5 12h.01"],
};
export const Icon = ({ name }) => html`
  <svg class="icon" viewBox="0 0 16 16" aria-hidden="true">${ICONS[name].map((d) => html`<path d=${d} />`)}</svg>`;

// A traffic light that is told by its shape, too.
const LIGHTS = { green: ["check", "verified"], amber: ["warn", "look closer"], red: ["stop", "not verified"] };
/** @param {{ tone: "green" | "amber" | "red", words?: boolean }} props */
export const Light = ({ tone, words }) => html`<span class=${`lamp ${tone}`} title=${LIGHTS[tone][1]}>
  <${Icon} name=${LIGHTS[tone][0]} />${words && LIGHTS[tone][1]}</span>`;

// A button never keeps the focus: keys work whatever was clicked last.
const clicked = (onClick) => (event) => {
  event.currentTarget.blur();
  onClick?.(event);
};

// `engine`: what it does is computed or written by the program; a page that is a file has none.
export function Button({ onClick, title, icon, on, kind = "", disabled, engine, children }) {
  const lacks = engine && state.file ? `It needs the program: ${state.file.command}` : null;
  return html`<button type="button" class=${`button ${kind} ${on ? "on" : ""} ${lacks ? "lacks" : ""}`}
    disabled=${disabled && !lacks} aria-disabled=${lacks ? "true" : undefined}
    title=${lacks ? `${title}. ${lacks}` : title} aria-pressed=${on == null ? undefined : String(Boolean(on))}
    onClick=${clicked(lacks ? () => toast("note", lacks) : onClick)}>
    ${icon && html`<${Icon} name=${icon} />`}${children}
  </button>`;
}

export const IconButton = (props) => html`<${Button} ...${props} kind=${`square ${props.kind ?? ""}`} />`;

// options: [value] or [[value, words]].
export const Select = ({ value, options, onChange, title, label }) => html`
  <label class="select" title=${title}>${label && html`<span>${label}</span>`}
    <select value=${value} onChange=${(e) => { e.currentTarget.blur(); onChange(e.currentTarget.value); }}>
      ${options.map((o) => (Array.isArray(o) ? o : [o, o])).map(([v, words]) => html`
        <option value=${v} selected=${v === value}>${words}</option>`)}
    </select>
  </label>`;

export const Toggle = ({ value, onChange, title, children }) => html`
  <label class="toggle" title=${title}>
    <input type="checkbox" checked=${value}
      onChange=${(e) => { e.currentTarget.blur(); onChange(e.currentTarget.checked); }} />
    <span>${children}</span>
  </label>`;

export const Swatch = ({ color, hollow }) => html`
  <i class=${`swatch ${hollow ? "hollow" : ""}`} style=${{ [hollow ? "borderColor" : "background"]: color }} />`;

// A share of 0 to 1 as a bar.
export const Bar = ({ share, color, title }) => html`
  <span class="bar" title=${title}><i
    style=${{ width: `${100 * Math.max(0, Math.min(1, share ?? 0))}%`, background: color }} /></span>`;

// Parts of a whole, beside each other: [[words, number, colour]].
export const Parts = ({ parts }) => {
  const sum = parts.reduce((n, [, x]) => n + x, 0) || 1;
  return html`<span class="parts">${parts.filter(([, x]) => x > 0).map(([words, x, color]) => html`
    <i style=${{ width: `${(100 * x) / sum}%`, background: color }}
      title=${`${words}: ${x} (${((100 * x) / sum).toFixed(0)} %)`} />`)}</span>`;
};

export function number(x, digits = 2) {
  if (x == null || !Number.isFinite(x)) return "–";
  const text = x.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text; // no minus before zero
}

/** A number with its noun: "1 note", "2 notes". */
export const counted = (n, one, several = `${one}s`) => `${n} ${n === 1 ? one : several}`;

/**
 * A column of a table. `of`: the cell; `value`: by what a table that sorts does so.
 * @template R
 * @typedef {{ title: unknown, hint?: string, left?: boolean, of?: (row: R, i: number) => unknown,
 *   value?: (row: R) => number | string | null | undefined }} Column
 */
/**
 * Columns for such rows, so that each knows what a row is.
 * @template R
 * @param {R[]} _rows
 * @param {Column<R>[]} columns
 */
export const columnsOf = (_rows, columns) => columns;

// columns: `Column`s with cells; a row is clicked.
export const Table = ({ columns, rows, onRow, current, keyOf = (_, i) => i }) => html`
  <table class="table">
    <thead><tr>${columns.map((c) => html`<th class=${c.left ? "left" : ""}
      title=${c.hint}>${c.title}</th>`)}</tr></thead>
    <tbody>${rows.map((row, i) => html`
      <tr key=${keyOf(row, i)} class=${`${onRow ? "clickable" : ""} ${current?.(row, i) ? "current" : ""}`}
        onClick=${onRow && (() => onRow(row, i))}>
        ${columns.map((c) => html`<td class=${c.left ? "left" : ""}>${c.of(row, i)}</td>`)}
      </tr>`)}
    </tbody>
  </table>`;

// Opens below its button and closes on a click elsewhere, or Esc. children: what it holds, or a function of `close`.
export function Menu({ label, title, icon, kind = "", align = "left", children }) {
  const [open, setOpen] = useState(false);
  const root = useRef(null);
  useEffect(() => {
    if (!open) return undefined;
    const outside = (e) => root.current?.contains(e.target) || setOpen(false);
    const escape = (e) => {
      if (e.key !== "Escape") return;
      e.stopPropagation();
      setOpen(false);
    };
    addEventListener("pointerdown", outside, true);
    addEventListener("blur", outside); // a click into the 3D pane
    addEventListener("keydown", escape, true);
    return () => {
      removeEventListener("pointerdown", outside, true);
      removeEventListener("blur", outside);
      removeEventListener("keydown", escape, true);
    };
  }, [open]);
  const popup = useRef(null);
  // One that would leave the window is moved back into it.
  useEffect(() => {
    if (!open) return;
    const { left, right } = popup.current.getBoundingClientRect();
    const by = Math.min(0, innerWidth - 8 - right) + Math.max(0, 8 - left);
    if (by) popup.current.style.transform = `translateX(${by}px)`;
  }, [open]);
  const close = () => setOpen(false);
  return html`<div class="menu" ref=${root}>
    <${Button} kind=${kind} title=${title} icon=${icon} on=${open || undefined}
      onClick=${() => setOpen(!open)}>${label}<//>
    ${open && html`<div class=${`popup ${align}`} ref=${popup}>${typeof children === "function" ? children(close) : children}</div>`}
  </div>`;
}

export const MenuItem = ({ onClick, on, title, detail, children }) => html`
  <button type="button" class=${`item ${on ? "on" : ""}`} title=${title} onClick=${clicked(onClick)}>
    <span>${children}</span>${detail && html`<span class="dim">${detail}</span>`}
  </button>`;

// One row of tabs; those that do not fit are in a menu at its end. tabs: [{ id, title, dim, hint,
// shortcut }].
const hintOf = (t) => `${t.hint}${t.shortcut ? ` (${t.shortcut})` : ""}`;
export function Tabs({ tabs, value, onChange }) {
  const row = useRef(null);
  const [fits, setFits] = useState(tabs.length);
  useLayoutEffect(() => {
    const measure = () => {
      // The hidden twin holds every tab at its full width.
      const room = row.current.clientWidth;
      const widths = [...row.current.querySelectorAll(".measure > *")].map((e) => e.offsetWidth);
      const all = widths.reduce((a, b) => a + b, 0);
      const more = parseFloat(getComputedStyle(document.documentElement).fontSize) * 2.6;
      let n = 0;
      for (let sum = 0; n < widths.length
        && sum + widths[n] <= (all <= room ? room : room - more); n++) sum += widths[n];
      setFits(n);
    };
    const observer = new ResizeObserver(measure);
    observer.observe(row.current);
    measure();
    return () => observer.disconnect();
  }, [tabs.map((t) => t.title).join()]);
  const tab = (t) => html`
    <button type="button" role="tab" class=${`tab ${t.id === value ? "on" : ""} ${t.dim ? "empty" : ""}`} key=${t.id}
      title=${hintOf(t)} aria-selected=${String(t.id === value)}
        onClick=${clicked(() => onChange(t.id))}>${t.title}</button>`;
  // The tab that is open is always in the row.
  const first = tabs.slice(0, fits);
  const at = tabs.findIndex((t) => t.id === value);
  if (at >= fits && fits > 0) first[fits - 1] = tabs[at];
  const rest = tabs.filter((t) => !first.includes(t));
  return html`<div class="tabs" role="tablist" ref=${row}>
    <div class="measure" aria-hidden="true">${tabs.map((t) => html`<span class="tab">${t.title}</span>`)}</div>
    ${first.map(tab)}
    ${rest.length > 0 && html`<${Menu} icon="more" kind="square" align="right" title=${`${rest.length} more tabs`}>
      ${(close) => rest.map((t) => html`<${MenuItem} key=${t.id} title=${hintOf(t)}
        detail=${html`${t.hint}${t.shortcut && html`<kbd>${t.shortcut}</kbd>`}`}
        onClick=${() => { close(); onChange(t.id); }}>${t.title}<//>`)}
    <//>`}
  </div>`;
}

// Drags a share of its parent's width or height; `invert`: what it sizes lies behind it.
export function Splitter({ axis, share, onShare, invert, area }) {
  const start = (down) => {
    down.preventDefault();
    const bar = down.currentTarget;
    const room = bar.parentElement.getBoundingClientRect();
    // Bars above and below have no share of the height.
    const bars = [...bar.parentElement.querySelectorAll(":scope > .verdict, :scope > .film, :scope > .status")];
    const height = bars.reduce((rest, one) => rest - one.offsetHeight, room.height);
    const [from, size] = axis === "x" ? [down.clientX, room.width] : [down.clientY, height];
    bar.setPointerCapture(down.pointerId);
    document.body.classList.add("dragging"); // the 3D pane would take the pointer
    const move = (e) => onShare(share + ((axis === "x" ? e.clientX : e.clientY) - from) / size * (invert ? -1 : 1));
    const up = () => {
      bar.removeEventListener("pointermove", move);
      bar.removeEventListener("pointerup", up);
      bar.removeEventListener("pointercancel", up);
      document.body.classList.remove("dragging");
    };
    bar.addEventListener("pointermove", move);
    bar.addEventListener("pointerup", up);
    bar.addEventListener("pointercancel", up);
  };
  return html`<div class=${`splitter ${axis} ${area}`} style=${{ gridArea: area }} onPointerDown=${start} />`;
}

export function Dialog({ title, onClose, children, wide }) {
  return html`<div class="veil" onPointerDown=${(e) => e.target === e.currentTarget && onClose()}>
    <section class=${`dialog ${wide ? "wide" : ""}`} role="dialog" aria-label=${title}>
      ${title && html`<header><h2>${title}</h2><${IconButton} icon="close" title="close (Esc)"
        onClick=${onClose} /></header>`}
      ${children}
    </section>
  </div>`;
}

// The frame of a pane. A double click on its title fills the middle with it, and so does F while the pointer is over
// it.
// tools: what stands beside the title.
export function Pane({ name, title, tools, children }) {
  const full = useStore((s) => s.view.full);
  return html`<section class=${`pane ${name}`} onPointerEnter=${() => (state.lastPane = name)}>
    <header onDblClick=${(e) => e.target.closest("button, select, input") || fillPane(name)}
      title="double click: fill the middle (F)">
      <h2>${title}</h2><div class="tools">${tools}</div>
      <${IconButton} icon=${full === name ? "shrink" : "fill"} title=${full === name
        ? "all panes (F)" : "fill the middle (F)"}
        onClick=${() => fillPane(name)} />
    </header>
    <div class="content">${children}</div>
  </section>`;
}
export function fillPane(name) {
  setView({ full: state.view.full === name ? null : name });
}
