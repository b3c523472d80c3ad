// The plot of a gallery: scores of answers over their errors, or over how far they are undetermined.
import { html } from "htm/preact";
import { useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import { state, useStore } from "./store.js";
import { limits } from "./palette.js";
import { number } from "./ui.js";
import { errorWords, openAnswer, openRow, shareOf, TONES, visible } from "./answers.js";

/** @import { GalleryRow } from "./messages.d.ts" */

const [LOW, HIGH] = [0.003, 2]; // of the diameter
const MOST_MM = 30; // of what is undetermined
/**
 * What scores are drawn over: errors, or where none is known how far the answers are undetermined. `at`: from 0 to 1.
 * @type {{ title: string, words: string, of: (row: GalleryRow) => number | null, at: (value: number) => number,
 *   isLimit: (value: number) => boolean, ticks: [number, string][], counted: string }[]}
 */
const AXES = [
  { title: "Score over error", words: "error [share of the diameter]", of: shareOf,
    at: (share) => Math.log(Math.max(LOW, Math.min(HIGH, share)) / LOW) / Math.log(HIGH / LOW), isLimit: (share) => share === limits.correct,
    ticks: [[0.01, "1 %"], [0.1, "10 %"], [1, "100 %"]], counted: "with ground truth" },
  { title: "Score over uncertainty", words: "undetermined [mm]", of: (row) => row.undetermined_mm,
    at: (mm) => Math.min(MOST_MM, mm) / MOST_MM, isLimit: () => false, ticks: [[0, "0"], [10, "10"], [20, "20"], [MOST_MM, `${MOST_MM}`]], counted: "without ground truth" },
];
const REACH = 14; // pixels from a point within which the pointer is about it
const isOn = (axis) => (row) => row.score != null && axis.of(row) != null;
const axisOf = (rows) => AXES.find((axis) => rows.some(isOn(axis)));
export const plotTitle = (rows) => axisOf(rows)?.title;

// of: some of the answers; all of them where it is left out.
export function Plot({ of }) {
  const answers = useStore((s) => s.answers);
  const axis = axisOf(of ?? answers.rows);
  return axis ? html`<${Points} of=${of} axis=${axis} />` : null;
}

// Where the numbers of an answer are on a canvas of w × h pixels.
function placeOf(axis, known, { w, h, rem }) {
  const [left, right, low, high] = [2.4 * rem, w - 0.6 * rem, h - 2.5 * rem, 0.6 * rem];
  const floor = Math.min(0.9, Math.floor(10 * Math.min(...known.map((row) => row.score), 0.9)) / 10);
  const x = (value) => left + axis.at(value) * (right - left);
  const y = (score) => low - ((Math.max(floor, Math.min(1, score)) - floor) / (1 - floor)) * (low - high);
  return { left, right, low, high, floor, x, y };
}

function drawAxes(ctx, axis, { left, right, low, high, floor, x, y }, color, rem) {
  ctx.strokeStyle = color("--line");
  ctx.fillStyle = color("--dim");
  ctx.lineWidth = 1;
  const line = (x0, y0, x1, y1) => {
    ctx.beginPath();
    ctx.moveTo(Math.round(x0) + 0.5, Math.round(y0) + 0.5);
    ctx.lineTo(Math.round(x1) + 0.5, Math.round(y1) + 0.5);
    ctx.stroke();
  };
  ctx.textAlign = "right";
  ctx.textBaseline = "middle";
  for (const score of [floor, (floor + 1) / 2, 1]) {
    line(left, y(score), right, y(score));
    ctx.fillText(score.toFixed(2).replace(/0$/, ""), left - 0.3 * rem, y(score));
  }
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  for (const [value, words] of axis.ticks) {
    ctx.setLineDash(axis.isLimit(value) ? [4, 3] : []);
    ctx.strokeStyle = color(axis.isLimit(value) ? "--dim" : "--line");
    line(x(value), high, x(value), low);
    ctx.fillText(words, x(value), low + 0.25 * rem);
  }
  ctx.setLineDash([]);
  ctx.fillText(axis.words, (left + right) / 2, low + 1.3 * rem);
}

// Answers that pass, `strong`, lie over the others. Those that are wrong are crosses: not everybody can tell by the colour.
function drawPoints(ctx, points, strong, color, rem) {
  const isMany = points.length > 1000;
  const size = (isMany ? 0.25 : 0.42) * rem;
  ctx.lineWidth = 0.13 * rem;
  for (const isStrong of [false, true]) {
    ctx.globalAlpha = isStrong ? 0.8 : 0.15;
    for (const tone of ["right", "unknown", "doubt", "seen", "wrong"]) {
      ctx.fillStyle = ctx.strokeStyle = color(TONES[tone][2]);
      ctx.beginPath();
      for (const p of points) {
        if (p.row.tone !== tone || strong.has(p.row) !== isStrong) continue;
        if (isMany) ctx.fillRect(p.x - size / 2, p.y - size / 2, size, size); // circles take 20 times as long
        else if (tone === "wrong") {
          const r = 0.55 * size;
          for (const down of [r, -r]) {
            ctx.moveTo(p.x - r, p.y - down);
            ctx.lineTo(p.x + r, p.y + down);
          }
        } else {
          ctx.moveTo(p.x + size / 2, p.y);
          ctx.arc(p.x, p.y, size / 2, 0, 7);
        }
      }
      if (tone === "wrong") ctx.stroke();
      else ctx.fill();
    }
  }
}

// Draws all; returns where each answer is: [{ row, x, y }].
function draw(canvas, axis, known, strong) {
  const ratio = devicePixelRatio || 1;
  const [w, h] = [canvas.clientWidth, canvas.clientHeight];
  [canvas.width, canvas.height] = [w * ratio, h * ratio];
  const ctx = canvas.getContext("2d");
  ctx.scale(ratio, ratio);
  const css = getComputedStyle(canvas);
  const color = (name) => css.getPropertyValue(name);
  const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
  const place = placeOf(axis, known, { w, h, rem });
  ctx.font = `${0.85 * rem}px ${css.fontFamily}`;
  drawAxes(ctx, axis, place, color, rem);
  const points = known.map((row) => ({ row, x: place.x(axis.of(row)), y: place.y(row.score) }));
  drawPoints(ctx, points, strong, color, rem);
  return points;
}

function Points({ of, axis }) {
  const [answers, theme, open] = useStore((s) => [s.answers, s.theme, openRow(s)?.key, s.gallery]);
  const canvas = useRef(null);
  const [near, setNear] = useState(null);
  const [points, setPoints] = useState([]);
  const rows = visible(state);
  const known = useMemo(() => (of ?? answers.rows).filter(isOn(axis)), [answers, of?.length, axis]);
  useLayoutEffect(() => {
    const observer = new ResizeObserver(() => { // draws at once, too
      setPoints(draw(canvas.current, axis, known, new Set(of ?? rows)));
    });
    observer.observe(canvas.current);
    return () => observer.disconnect();
  }, [rows, theme, known]);
  const find = (e) => {
    const box = canvas.current.getBoundingClientRect();
    const [u, v] = [e.clientX - box.left, e.clientY - box.top];
    const passing = new Set(of ?? rows);
    const distance = (p) => Math.hypot(p.x - u, p.y - v) + (passing.has(p.row) ? 0 : 4);
    const best = points.reduce((a, b) => (a && distance(a) <= distance(b) ? a : b), null);
    return best && distance(best) <= REACH ? best : null;
  };
  return html`<section class="plot">${!of && html`<h3>${axis.title}</h3>`}
    <div class="rings">${points.filter((p) => p.row.key === open || p.row.key === near?.row.key).map((p) => html`
      <i key=${p.row.key} style=${{ transform: `translate(${p.x}px, ${p.y}px)` }} />`)}</div>
    <canvas ref=${canvas} class=${near ? "near" : ""} onPointerMove=${(e) => setNear(find(e))} onPointerLeave=${() => setNear(null)} onClick=${(e) => openAnswer(find(e)?.row)} />
    <p>${near ? html`<b>${near.row.name}</b> ${near.row.frame} · ${errorWords(near.row)} · score ${number(near.row.score, 2)}` : html`<span class="dim">${known.length} ${axis.counted}</span>`}</p>
  </section>`;
}
