// Curves over uPlot: named axes with units, a legend of what is drawn in which series are chosen, a cursor that seeks.
import { html, useEffect, useRef, useState } from "./vendor/htm-preact.js";
import uPlot from "./vendor/uplot.js";
import { useStore } from "./store.js";
import { number, Swatch } from "./ui.js";

// series: [{ name, values, color, kind: "line" | "steps" | "points", dash, off }] over `x`; null = no value there.
// cursor: the x that is marked; onSeek(x): a click or drag; range: [low, high] of y; lines: [{ y, name }] across.
export function Chart({ series, x, xLabel = "iteration", yLabel, units = "", cursor, onSeek, range, lines = [],
  digits = 2, height = 13 }) {
  const host = useRef();
  const plot = useRef();
  const live = useRef({});
  const [off, setOff] = useState(() => new Set(series.filter((s) => s.off).map((s) => s.name)));
  const [hover, setHover] = useState(null);
  const [theme, size] = useStore((s) => [s.theme, `${innerWidth} ${innerHeight}`]); // fonts follow the window
  const key = series.map((s) => s.name).join("|");
  live.current = { cursor, onSeek, lines };

  useEffect(() => {
    const css = getComputedStyle(host.current);
    const [text, line] = ["--dim", "--line"].map((name) => css.getPropertyValue(name));
    const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
    const font = `${(0.88 * rem).toFixed(1)}px ${css.fontFamily}`;
    const axis = (label) => ({
      label, labelFont: font, font, stroke: text, labelSize: 1.5 * rem, grid: { stroke: line, width: 1 },
        ticks: { show: false },
    });
    const width = () => Math.max(host.current.clientWidth, 40);
    const u = new uPlot(
      {
        width: width(), height: height * rem, legend: { show: false }, padding: [0.5 * rem, 0.8 * rem, 0, 0],
        scales: {
          x: { time: false },
          // What is drawn across is in view, too.
          y: { range: range ?? ((_, low, high) => {
            const all = [low, high, ...live.current.lines.map((l) => l.y)].filter((v) => v != null);
            const [least, most] = [Math.min(...all), Math.max(...all)];
            const pad = (most - least || 1) * 0.08;
            return [least >= 0 ? Math.max(0, least - pad) : least - pad, most + pad];
          }) },
        },
        axes: [
          { ...axis(xLabel), size: 1.9 * rem, values: (_, at) => at.map((v) => (Number.isInteger(v) ? v : "")) },
          { ...axis(units ? `${yLabel} [${units}]` : yLabel), size: 3.1 * rem },
        ],
        series: [{}, ...series.map((s) => ({
          label: s.name, stroke: s.color, width: s.kind === "points" ? 0 : 0.13 * rem, dash: s.dash
            ? [5, 4] : undefined,
          show: !off.has(s.name), spanGaps: true, paths: s.kind === "steps"
            ? uPlot.paths.stepped({ align: 1 }) : undefined,
          points: { show: s.kind === "points" || x.length < 2, size: 0.4 * rem, fill: s.color, stroke: s.color },
        }))],
        cursor: {
          y: false, drag: { x: false, y: false }, points: { size: 0.5 * rem },
        },
        hooks: {
          setCursor: [(p) => setHover(p.cursor.idx ?? null)],
          draw: [(p) => {
            const { ctx, bbox } = p;
            ctx.save();
            ctx.strokeStyle = text;
            for (const { y } of live.current.lines) {
              const at = p.valToPos(y, "y", true);
              if (at < bbox.top || at > bbox.top + bbox.height) continue;
              ctx.setLineDash([6, 4]);
              ctx.beginPath();
              ctx.moveTo(bbox.left, at);
              ctx.lineTo(bbox.left + bbox.width, at);
              ctx.stroke();
            }
            ctx.restore();
            place(p);
          }],
        },
      },
      [x, ...series.map((s) => s.values)],
      host.current,
    );
    const mark = document.createElement("div");
    mark.className = "chart-cursor";
    u.over.append(mark);
    const place = (p) => {
      const at = live.current.cursor;
      mark.hidden = at == null || at < p.scales.x.min || at > p.scales.x.max;
      if (at != null) mark.style.transform = `translateX(${p.valToPos(at, "x").toFixed(1)}px)`;
    };
    place(u);
    const seekTo = (e) => live.current.onSeek?.(Math.round(u.posToVal(e.clientX - u.over.getBoundingClientRect().left,
      "x")));
    u.over.addEventListener("pointerdown", (e) => {
      u.over.setPointerCapture(e.pointerId);
      seekTo(e);
    });
    u.over.addEventListener("pointermove", (e) => u.over.hasPointerCapture(e.pointerId) && seekTo(e));
    const observer = new ResizeObserver(() => width() !== u.width
      && u.setSize({ width: width(), height: height * rem }));
    observer.observe(host.current);
    plot.current = { u, place };
    return () => {
      observer.disconnect();
      u.destroy();
    };
  }, [key, theme, units, yLabel, String(range), size]);

  useEffect(() => plot.current.u.setData([x, ...series.map((s) => s.values)]), [x, ...series.map((s) => s.values)]);
  useEffect(() => plot.current.place(plot.current.u), [cursor]);
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
