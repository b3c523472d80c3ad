// What reports are made of: tables that sort, bars, intervals, and charts that fill their place at any width.
import { html } from "htm/preact";
import { useState } from "preact/hooks";
import { limits, palette } from "./palette.js";
import { Swatch, Table, number } from "./ui.js";

/** @import { ReportGroup } from "./messages.d.ts" */

export const colorOf = (i) => palette.runs[i % palette.runs.length];
const dashOf = (i) => ["", "6 4", "2 3"][Math.floor(i / palette.runs.length) % 3];
export const limit = () => 100 * limits.correct; // % of the diameter: right is below
const MOST_BANDS = 4; // that can be read over each other; of more, the band of the group under the pointer

export const signed = (x, digits = 1) => {
  const text = number(x, digits).replace("-", "−");
  return x > 0 && Number(x.toFixed(digits)) !== 0 ? `+${text}` : text;
};
/**
 * The ends of an interval; nothing where there is none, or where it shows as the value alone.
 * @type {(of: number[], digits: number, show?: typeof number) => string}
 */
export const interval = ([value, low, high], digits, show = number) => {
  if (low == null) return "";
  const [a, v, b] = [low, value, high].map((x) => show(x, digits));
  return a === v && b === v ? "" : `${a} to ${b}`;
};

// A table that a click on a head sorts. columns: those of `Table`, and `value(row)`, by which it sorts.
export function Sorted({ name, columns, rows, most = 15 }) {
  const [by, setBy] = useState(null);
  const [isAll, setAll] = useState(false);
  const sorted = by == null ? rows : [...rows].sort((p, q) => {
    const [a, b] = [p, q].map(columns[by.column].value);
    if (a == null || b == null) return Number(a == null) - Number(b == null);
    return by.way * (typeof a === "string" ? a.localeCompare(b, "en", { numeric: true }) : a - b);
  });
  const head = (c, i) => {
    const isBy = by?.column === i;
    const sort = () => setBy({ column: i, way: isBy ? -by.way : c.left ? 1 : -1 });
    return html`<button type="button" class="link sort" title=${c.hint ?? "sort"} onClick=${sort}>${c.title}${
      isBy ? (by.way < 0 ? " ↓" : " ↑") : ""}</button>`;
  };
  const shown = columns.map((c, i) =>
    ({ ...c, title: c.value ? head(c, i) : c.title, of: c.of ?? ((r) => c.value(r)) }));
  return html`<div class="scroll" data-table=${name}>
    <${Table} rows=${isAll ? sorted : sorted.slice(0, most)} columns=${shown} />
    ${!isAll && rows.length > most && html`<button type="button" class="link more"
      onClick=${() => setAll(true)}>All ${rows.length}</button>`}</div>`;
}

// A bar for each row, of parts: [words, value, colour]; all rows have one scale, up to `most`.
export function Bars({ rows, unit = "", digits = 0, onPart, most }) {
  const sum = (parts) => parts.reduce((all, [, v]) => all + v, 0);
  const end = most ?? Math.max(...rows.map((r) => sum(r.parts)), 1e-9);
  const part = (r, [words, v, color]) => html`<i class=${onPart ? "clickable" : ""}
    style=${{ width: `${(100 * v) / end}%`, background: color }} title=${`${words}: ${number(v, digits)} ${unit}`}
    onClick=${onPart && (() => onPart(words, r))} />`;
  return html`<div class="bars">${rows.map((r) => html`<span class="name">${r.name}</span>
    <span class="stack">${r.parts.filter(([, v]) => v > 0).map((one) => part(r, one))}</span>
    <b>${number(sum(r.parts), digits)} ${unit}</b>`)}</div>`;
}

// Names of colours: [[name, colour, value?]].
export const Key = ({ of }) => html`<div class="key">${of.map(([name, color, value]) => html`
  <span><${Swatch} color=${color} />${name}${value != null && html`<b>${value}</b>`}</span>`)}</div>`;

/**
 * The share of right objects of each group with its interval, the best first.
 * @param {{ groups: ReportGroup[] }} props
 */
export function Forest({ groups }) {
  const lines = groups.map((g, i) => ({ name: g.name, i, of: g.numbers.recall })).filter((l) => l.of)
    .sort((a, b) => b.of[0] - a.of[0]);
  const ends = lines.flatMap((l) => l.of).filter((x) => x != null);
  const low = Math.max(0, 10 * Math.floor((Math.min(...ends) - 1) / 10));
  const x = (v) => `${(100 * (v - low)) / (100 - low)}%`;
  const line = ({ name, i, of: [value, from, to] }) => {
    const background = colorOf(i);
    const ends = from == null ? "" : `, 95 %: ${number(from, 1)} to ${number(to, 1)} %`;
    const title = `${name}: ${number(value, 1)} %${ends}`;
    return html`<span class="name"><${Swatch} color=${background} />${name}</span>
      <span class="track" title=${title}><u style=${{ left: x(lines[0].of[0]) }} />
        ${from != null && html`<s style=${{ left: x(from), right: `calc(100% - ${x(to)})`, background }} />`}
        <i style=${{ left: x(value), background }} /></span>
      <b>${number(value, 1)} %</b>`;
  };
  return html`<div class="forest" role="img" aria-label="objects right, with 95 % intervals">${lines.map(line)}
    <span /><span class="ends dim"><span>${low} %</span><span>objects right</span><span>100 %</span></span><span />
  </div>`;
}

// Charts: what is drawn has coordinates from 0 to 100; lines keep their width and points stay round.

const linear = (v, low, high) => (100 * (v - low)) / (high - low || 1);
export const log = (v, low, high) => (100 * Math.log(Math.max(low, Math.min(high, v)) / low)) / Math.log(high / low);
function ticksOf(low, high) {
  const steps = [-2, -1, 0, 1, 2, 3, 4, 5].flatMap((e) => [1, 2, 5].map((s) => s * 10 ** e));
  const step = steps.find((s) => (high - low) / s <= 6) ?? high - low;
  const n = Math.floor((high - low) / step + 1e-9) + 1;
  return Array.from({ length: n }, (_, i) => Number((low + i * step).toFixed(6)));
}
export const axis = (words, low, high, scale = linear, ticks = ticksOf(low, high)) =>
  ({ words, ticks, at: (v) => scale(v, low, high) });
export const pathOf = (xs, ys, x, y) =>
  xs.map((v, i) => `${i ? "L" : "M"}${x.at(v).toFixed(2)} ${(100 - y.at(ys[i])).toFixed(2)}`).join("");

// x, y: axes; onHover: the place of the pointer from left to right, null where it left.
export function Drawing({ x, y, children, onHover, square }) {
  const move = (e) => {
    const box = e.currentTarget.getBoundingClientRect();
    onHover?.((e.clientX - box.left) / box.width);
  };
  return html`<div class=${`drawing ${square ? "square" : ""}`}>
    <div class="y-words dim"><span>${y.words}</span></div>
    <div class="y-ticks dim">${y.ticks.map((v) => html`<span style=${{ bottom: `${y.at(v)}%` }}>${v}</span>`)}</div>
    <svg viewBox="0 0 100 100" preserveAspectRatio="none" onPointerMove=${move} onPointerLeave=${() => onHover?.(null)}>
      <g class="grid">${y.ticks.map((v) => html`<path d=${`M0 ${100 - y.at(v)}H100`} />`)}
        ${x.ticks.map((v) => html`<path d=${`M${x.at(v)} 0V100`} />`)}</g>
      ${children}</svg>
    <div class="x-ticks dim">${x.ticks.map((v) => html`<span style=${{ left: `${x.at(v)}%` }}>${v}</span>`)}</div>
    <div class="x-words dim">${x.words}</div>
  </div>`;
}

export const Dot = ({ at: [u, v], color, faint, onClick, children }) => html`
  <path class=${`point ${onClick ? "clickable" : ""}`} d=${`M${u.toFixed(2)} ${(100 - v).toFixed(2)}h0.001`}
    style=${{ stroke: color, opacity: faint ? 0.45 : 0.85 }} onClick=${onClick}><title>${children}</title></path>`;

/**
 * Recall over the error limit; the key has the numbers at the pointer.
 * @param {{ groups: ReportGroup[], thresholds: number[], best: number }} props
 */
export function Recall({ groups, thresholds, best }) {
  const [at, setAt] = useState(null);
  const [lit, setLit] = useState(null);
  const last = thresholds.length - 1;
  const x = axis("error below [% of the diameter]", 0, thresholds[last]);
  const y = axis("objects [%]", 0, 100);
  const known = groups.map((g, i) => ({ ...g.curve, name: g.name, i })).filter((c) => c.recall);
  const banded = (known.length <= MOST_BANDS ? known : known.filter((c) => c.i === (lit ?? best))).filter((c) => c.low);
  const marked = at ?? thresholds.indexOf(limit());
  const band = ({ low, high }) => {
    const back = pathOf([...thresholds].reverse(), [...low].reverse(), x, y).replace("M", "L");
    return `${pathOf(thresholds, high, x, y)}${back}Z`;
  };
  const hover = (share) => setAt(share == null ? null : Math.max(0, Math.min(last, Math.round(share * last))));
  return html`<${Drawing} x=${x} y=${y} onHover=${hover}>
    ${banded.map((c) => html`<path class="band" style=${{ "--color": colorOf(c.i) }} d=${band(c)} />`)}
    <path class="limit" d=${`M${x.at(limit())} 0V100`} />
    ${at != null && html`<path class="hover" d=${`M${x.at(thresholds[at])} 0V100`} />`}
    ${known.map((c) => html`<path class=${`curve ${lit != null && lit !== c.i ? "faint" : ""}`} stroke=${colorOf(c.i)}
      stroke-dasharray=${dashOf(c.i)} d=${pathOf(thresholds, c.recall, x, y)} />`)}
  <//>
  <div class="key"><span class="dim">below ${number(thresholds[marked], 1)} %:</span>${known.map((c) => html`
    <span onPointerEnter=${() => setLit(c.i)} onPointerLeave=${() => setLit(null)}>
      ${known.length > 1 && html`<${Swatch} color=${colorOf(c.i)} />${c.name}`}<b>${number(c.recall[marked], 1)} %</b>
      ${c.low && html`<small>${interval([c.recall, c.low, c.high].map((values) => values[marked]), 1)}</small>`}
    </span>`)}</div>`;
}
