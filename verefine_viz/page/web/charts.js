// Curves over uPlot: named axes with units, a legend of what is drawn in which series are chosen, a cursor that seeks.
import { html } from "htm/preact";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import uPlot from "uplot";
import { useStore } from "./store.js";
import { number, Swatch } from "./ui.js";

/**
 * A curve over `x`.
 * @typedef {object} Series
 * @property {string} name
 * @property {(number | null)[]} values  null = none there
 * @property {string} color
 * @property {"line" | "steps" | "points"} [kind]
 * @property {boolean} [dash]
 * @property {boolean} [off]  whether it is hidden at first
 */

const pixels = () => parseFloat(getComputedStyle(document.documentElement).fontSize); // of a rem

// The ends of y: with what is drawn across, and some room; no nearer than `span`, so that noise is not drawn as motion.
function padded(low, high, lines, span) {
  const all = [low, high, ...lines.map((l) => l.y)].filter((v) => v != null);
  const least = Math.min(...all);
  const most = Math.max(...all, least + span);
  const pad = (most - least || 1) * 0.08;
  return [least >= 0 ? Math.max(0, least - pad) : least - pad, most + pad];
}

function drawAcross(u, lines, color) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.strokeStyle = color;
  for (const { y } of lines) {
    const at = u.valToPos(y, "y", true);
    if (at < bbox.top || at > bbox.top + bbox.height) continue;
    ctx.setLineDash([6, 4]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, at);
    ctx.lineTo(bbox.left + bbox.width, at);
    ctx.stroke();
  }
  ctx.restore();
}

// How uPlot draws them; `live`: what may change while the plot stays.
function optionsOf({ host, series, x, xLabel, yLabel, units, range, span, live, off }) {
  const css = getComputedStyle(host);
  const [text, line] = ["--dim", "--line"].map((name) => css.getPropertyValue(name));
  const rem = pixels();
  const font = `${(0.88 * rem).toFixed(1)}px ${css.fontFamily}`;
  const axis = (label) => ({
    label, labelFont: font, font, stroke: text, labelSize: 1.5 * rem, grid: { stroke: line, width: 1 },
    ticks: { show: false },
  });
  return {
    legend: { show: false }, padding: [0.5 * rem, 0.8 * rem, 0, 0],
    scales: { x: { time: false }, y: { range: range ?? ((_, low, high) => padded(low, high, live.current.lines, span)) } },
    axes: [
      { ...axis(xLabel), size: 1.9 * rem, values: (_, at) => at.map((v) => (Number.isInteger(v) ? v : "")) },
      { ...axis(units ? `${yLabel} [${units}]` : yLabel), size: 3.1 * rem },
    ],
    series: [{}, ...series.map((s) => ({
      label: s.name, stroke: s.color, width: s.kind === "points" ? 0 : 0.13 * rem, dash: s.dash ? [5, 4] : undefined,
      show: !off.has(s.name), spanGaps: true,
      paths: s.kind === "steps" ? uPlot.paths.stepped({ align: 1 }) : undefined,
      points: { show: s.kind === "points" || x.length < 2, size: 0.4 * rem, fill: s.color, stroke: s.color },
    }))],
    cursor: { y: false, drag: { x: false, y: false }, points: { size: 0.5 * rem } },
    hooks: { draw: [(plot) => drawAcross(plot, live.current.lines, text)] },
  };
}

// A plot in an element, with a mark that `place` moves to the cursor; `end` takes it away.
function plotted(host, height, options, data, { onHover, live }) {
  const size = () => ({ width: Math.max(host.clientWidth, 40), height: height * pixels() });
  const mark = Object.assign(document.createElement("div"), { className: "chart-cursor" });
  const place = (u) => {
    const at = live.current.cursor;
    mark.hidden = at == null || at < u.scales.x.min || at > u.scales.x.max;
    if (at != null) mark.style.transform = `translateX(${u.valToPos(at, "x").toFixed(1)}px)`;
  };
  const hooks = { setCursor: [(u) => onHover(u.cursor.idx ?? null)], draw: [...options.hooks.draw, place] };
  const u = new uPlot({ ...options, ...size(), hooks }, data, host);
  u.over.append(mark);
  place(u);
  const seekTo = (e) => live.current.onSeek?.(Math.round(u.posToVal(e.clientX - u.over.getBoundingClientRect().left, "x")));
  u.over.addEventListener("pointerdown", (e) => {
    u.over.setPointerCapture(e.pointerId);
    seekTo(e);
  });
  u.over.addEventListener("pointermove", (e) => u.over.hasPointerCapture(e.pointerId) && seekTo(e));
  const observer = new ResizeObserver(() => size().width !== u.width && u.setSize(size()));
  observer.observe(host);
  const end = () => {
    observer.disconnect();
    u.destroy();
  };
  return { u, place: () => place(u), end };
}

/**
 * cursor: the x that is marked; onSeek(x): a click or drag; range: the ends of y; span: what they are apart at least; lines: what is drawn across.
 * @param {{ series: Series[], x: number[], xLabel?: string, yLabel: string, units?: string, cursor?: number | null,
 *   onSeek?: (x: number) => void, range?: [number, number], span?: number, lines?: { y: number, name: string }[], digits?: number,
 *   height?: number }} props
 */
export function Chart({ series, x, xLabel = "iteration", yLabel, units = "", cursor, onSeek, range, span = 0, lines = [],
  digits = 2, height = 13 }) {
  const host = useRef(null);
  const plot = useRef(null);
  const live = useRef({ cursor, onSeek, lines });
  const [off, setOff] = useState(() => new Set(series.filter((s) => s.off).map((s) => s.name)));
  const [hover, setHover] = useState(null);
  const [theme, size] = useStore((s) => [s.theme, `${innerWidth} ${innerHeight}`]); // fonts follow the window
  const key = series.map((s) => s.name).join("|");
  const data = [x, ...series.map((s) => s.values)];
  live.current = { cursor, onSeek, lines };

  useLayoutEffect(() => {
    const options = optionsOf({ host: host.current, series, x, xLabel, yLabel, units, range, span, live, off });
    plot.current = plotted(host.current, height, options, data, { onHover: setHover, live });
    return plot.current.end;
  }, [key, theme, units, yLabel, String(range), span, size]);
  useEffect(() => plot.current.u.setData(data), data);
  useEffect(() => plot.current.place(), [cursor]);
  const toggle = (name, i) => {
    const next = new Set(off);
    if (!next.delete(name)) next.add(name);
    setOff(next);
    plot.current.u.setSeries(i + 1, { show: !next.has(name) });
  };
  const at = hover ?? (cursor == null ? -1 : x.findLastIndex((k) => k <= cursor));
  return html`<div class="chart">
    <div class="plot" ref=${host} />
    <div class="chart-legend">${series.map((s, i) => html`
      <button type="button" key=${s.name} class=${off.has(s.name) ? "off" : ""}
        title=${off.has(s.name) ? "show" : "hide"}
        onClick=${(e) => { e.currentTarget.blur(); toggle(s.name, i); }}>
        <${Swatch} color=${s.color} />${s.name}<b>${at >= 0 && s.values[at] != null
          ? number(s.values[at], digits) : ""}</b>
      </button>`)}
      ${lines.map((l) => html`<span class="dim">– – ${l.name}</span>`)}
    </div>
  </div>`;
}
