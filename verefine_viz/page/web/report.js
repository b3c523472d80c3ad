// The report of batches: what came out, how sure that is, why answers are wrong, and all of them as cards below.
import { html, useEffect, useRef, useState } from "./vendor/htm-preact.js";
import { state, useStore, on, update } from "./store.js";
import { Button, Icon, IconButton, Swatch, Table, number } from "./ui.js";
import { Gallery, Plot, choose, openAnswer } from "./gallery.js";
import { addKeys, titled } from "./keys.js";
import { applyTheme, presets, setPreset, switchTheme } from "./layout.js";

const COLORS = ["#3b8eea", "#f28e2b", "#2fae5f", "#d8504d", "#9a7bd0", "#a0715e", "#e377c2", "#a8a928", "#17b3c4",
  "#0f9d78", "#be3ca0", "#6e82eb"];
const colorOf = (i) => COLORS[i % COLORS.length];
const dashOf = (i) => ["", "6 4", "2 3"][Math.floor(i / COLORS.length) % 3];
const CAUSES = ["#4e79a7", "#f28e2b", "#e15759", "#76b7b2", "#59a14f", "#edc948", "#b07aa1", "#ff9da7", "#9c755f",
  "#86bcb6", "#d37295", "#a0cbe8"];
const STAGES = {
  read: ["read", "#8d99ae"], prepare: ["prepare models, once", "#c9b48a"], start: ["hypotheses", "#577590"],
  refine: ["refine", "#326eff"], simulate: ["simulate", "#ff8c00"], score: ["score", "#28c850"],
  rest: ["rest of the iterations", "#98a3b5"], grasp: ["grasp", "#e9c46a"], explain: ["look for causes", "#8a76a8"],
  summarise: ["summarise", "#c9ada7"], record: ["record", "#9a8c98"],
};
const LIMIT = 10; // % of the diameter: right is below
const MOST_BANDS = 4; // that can be read over each other; of more, the band of the group under the pointer

on("report", (report) => {
  update({ report });
  setPreset("report");
});
addKeys([{ id: "report", keys: ["r"], title: "Report", group: "Show", when: () => state.report,
  action: () => setPreset("report") }]);
addEventListener("beforeprint", () => (document.documentElement.dataset.theme = "light"));
addEventListener("afterprint", applyTheme);

const rowOf = (key) => state.answers?.rows[key];
const Answer = ({ of, children }) => html`<button type="button" class="link" title="Open this answer"
  onClick=${() => openAnswer(rowOf(of))}>${children}</button>`;
function showCards(only) {
  choose({ only, search: "", at: null });
  document.querySelector(".report .gallery").scrollIntoView({ behavior: "smooth" });
}
const percent = (x, digits = 1) => (x == null ? "none" : number(x, digits));
const signed = (x, digits = 1) => {
  const text = number(x, digits).replace("-", "−");
  return x > 0 && Number(x.toFixed(digits)) !== 0 ? `+${text}` : text;
};
// Whether a change is for the better, as a class.
const toneOf = (by, better, digits = 1) =>
  (by == null || !better || Number(by.toFixed(digits)) === 0 ? "" : by * better > 0 ? "good" : "bad");
const interval = ([value, low, high], digits, show = number) => {
  if (low == null) return "";
  const [a, v, b] = [low, value, high].map((x) => show(x, digits));
  return a === v && b === v ? "" : `${a} to ${b}`;
};

export function Report() {
  const [report, theme, preset, answers] = useStore((s) => [s.report, s.theme, s.view.preset, s.answers, s.frame]);
  const { sections } = report;
  const several = sections.length > 1;
  return html`<div class="report-all">
    <header class="report-head">
      <div><h1>${report.title}</h1>
        <p class="dim">${[report.session_title, report.counted].filter(Boolean).join(" · ")}</p></div>
      <nav class="presets" aria-label="Layout">${presets(state).map((p) => html`<${Button} on=${p.id === preset}
        title=${p.hint} onClick=${() => setPreset(p.id)}>${p.title}<//>`)}</nav>
      <${IconButton} icon=${theme === "light" ? "moon" : "sun"} title=${titled("theme")} onClick=${switchTheme} />
    </header>
    ${[...sections.map((s) => s.doubt), ...report.notes].filter(Boolean).map((words) => html`
      <p class="warning"><${Icon} name="warn" />${words}</p>`)}
    ${several && html`<${Overview} report=${report} />`}
    ${sections.map((section, i) => html`<${Section} key=${i} id=${`data-${i}`} section=${section} report=${report}
      titled=${several} />`)}
    <section class="pane gallery" style=${{ height: `min(100vh - 6rem, ${12 + 17 * Math.ceil((answers?.rows.length ?? 0) / 5)}rem)` }}>
      <${Gallery} /></section>
    ${report.left_out.length > 0 && html`<section class="block"><h2>Left out</h2>${report.left_out.map(([run, why]) => html`
      <p><b>${run}</b> ${why}</p>`)}</section>`}
  </div>`;
}

// All sets of data: what cannot be compared stands side by side.
function Overview({ report }) {
  const rows = report.sections.flatMap((section, i) => section.groups.map((group) => ({ section, group, i })));
  const columns = report.columns.filter((c) => rows.some(({ group }) => group.numbers[c.id]));
  return html`<section class="block"><h2>Side by side <span class="dim">each by its own data</span></h2>
    <${Sorted} name="overview" rows=${rows} columns=${[
      { title: "data", left: true, value: (r) => r.section.data, of: (r) => html`<button type="button" class="link"
        onClick=${() => document.getElementById(`data-${r.i}`).scrollIntoView({ behavior: "smooth" })}>${r.section.data}</button>` },
      { title: "group", left: true, value: (r) => r.group.name },
      { title: "objects", value: (r) => r.group.n_objects },
      ...columns.map((c) => numberColumn(c, (r) => r.group)),
    ]} /></section>`;
}

const numberColumn = (c, groupOf, best) => ({
  title: `${c.label}${c.unit ? ` [${c.unit}]` : ""}`, hint: c.hint, value: (r) => groupOf(r).numbers[c.id]?.[0],
  of: (r) => {
    const mine = groupOf(r).numbers[c.id];
    if (!mine) return "–";
    const words = number(mine[0], c.digits);
    return html`${best && mine[0] === best(c) ? html`<b>${words}</b>` : words}<small>${interval(mine, c.digits)}</small>`;
  },
});

function Section({ id, section, report, titled }) {
  const { groups } = section;
  const columns = report.columns.filter((c) => groups.some((g) => g.numbers[c.id]));
  const runs = new Set(groups.flatMap((g) => g.runs));
  const answers = useStore((s) => s.answers);
  const rows = answers?.rows.filter((row) => runs.has(row.run));
  const isPair = groups.length === 2;
  return html`<section class="data" id=${id}>
    ${titled && html`<h2 class="name">${section.data} <span class="dim">${section.session_title}</span></h2>`}
    <p class="lead">${section.headline}</p>
    ${section.next && html`<p class="next">${groups.length > 1 && html`<b>${groups[section.next.group].name}: </b>`}
      ${section.next.text} <${Answer} of=${section.next.key}>${section.next.begin}<//>.</p>`}
    ${groups.length <= 2 && html`<${Tiles} columns=${columns} groups=${groups} />`}
    ${groups.length > 1 && html`<${Groups} section=${section} columns=${columns} />`}
    <p class="basis dim">${[section.intervals, section.bop,
      groups.length > 1 && !section.same_objects ? "Not all runs have the same objects." : "",
      section.has_truth ? "" : "No ground truth: errors, recall and causes are not known."].filter(Boolean).join(" ")}</p>
    <div class="blocks">
      ${section.has_truth && html`<${Block} title="Recall" hint="share of objects whose ADD(-S) is below a limit">
        <${Recall} groups=${groups} thresholds=${report.thresholds} best=${section.best} /><//>`}
      ${rows?.some((r) => r.err != null && r.score != null) && html`<${Block} title="Score over error">
        <${Plot} of=${rows} />${groups.length <= 2 && groups.map((g) => g.misleads != null && html`<p class="dim">${groups.length > 1
          ? `${g.name}: w` : "W"}rong scores above right in ${number(100 * g.misleads, 0)} % of pairs.</p>`)}<//>`}
      ${groups.some((g) => g.causes.length) && html`<${Block} title="Why answers are wrong"><${Causes} groups=${groups} /><//>`}
      ${groups.some((g) => Object.keys(g.stages).length) && html`<${Block} title="Time a frame" hint="mean, by stage">
        <${Stages} groups=${groups} /><//>`}
      ${groups.some((g) => g.grasps.length) && html`<${Block} title="How grasps end"><${Grasps} groups=${groups} /><//>`}
      ${isPair && section.change && html`<${Change} change=${section.change} groups=${groups} />`}
      <${Objects} section=${section} />
      ${section.hardest.length > 0 && html`<${Hardest} section=${section} />`}
      ${section.tracks.length > 0 && html`<${Tracks} tracks=${section.tracks} />`}
    </div>
    <${Made} section=${section} />
  </section>`;
}

const Block = ({ title, hint, wide, children }) => html`<section class=${`block ${wide ? "wide" : ""}`}>
  <h2>${title} ${hint && html`<span class="dim">${hint}</span>`}</h2>${children}</section>`;

function Tiles({ columns, groups: [a, b] }) {
  return html`<div class="tiles">${columns.map((c) => {
    const [mine, theirs] = [a.numbers[c.id], b?.numbers[c.id]];
    const by = mine && theirs ? theirs[0] - mine[0] : null;
    return html`<div class="tile" title=${c.hint}><span class="dim">${c.label}</span>
      <b>${mine ? number(mine[0], c.digits) : "–"}${b && html`<span class="dim"> → </span>${theirs ? number(theirs[0], c.digits)
        : "–"}`}<small>${c.unit}</small></b>
      ${by != null && html`<span class=${toneOf(by, c.better, c.digits)}>${signed(by, c.digits)}</span>`}
      ${mine && !b && interval(mine, c.digits) && html`<span class="dim">${interval(mine, c.digits)}</span>`}</div>`;
  })}</div>`;
}

// A line for each group: numbers with intervals, the best of a column in bold.
function Groups({ section, columns }) {
  const { groups } = section;
  const best = (c) => {
    const all = groups.map((g) => g.numbers[c.id]?.[0]).filter((x) => x != null);
    return c.better && new Set(all).size > 1 ? (c.better > 0 ? Math.max(...all) : Math.min(...all)) : null;
  };
  const rows = groups.map((group, i) => ({ group, i }));
  if (!section.change) rows.sort((p, q) => (q.group.numbers.recall?.[0] ?? 0) - (p.group.numbers.recall?.[0] ?? 0));
  const behind = {
    title: "against the best", hint: "difference in right objects, in points, over the objects that both have",
    value: (r) => r.group.behind?.[0] ?? 0,
    of: ({ group, i }) => {
      if (!group.behind) return i === section.best ? "best" : "–";
      const [by, low, high] = group.behind;
      return html`<span class=${low > 0 || high < 0 ? toneOf(by, 1) : ""}>${signed(by)}</span><small>${interval(group.behind, 1, signed)}</small>`;
    },
  };
  return html`<${Block} title="Group by group" wide>
    ${section.has_truth && html`<${Forest} section=${section} />`}
    <${Sorted} name="groups" rows=${rows} columns=${[
      { title: "group", left: true, value: (r) => r.group.name, of: ({ group, i }) => html`<${Swatch} color=${colorOf(i)} />${group.name}` },
      { title: "runs", hint: "they differ in their seeds only", value: (r) => r.group.runs.length },
      ...columns.flatMap((c, i) => [numberColumn(c, (r) => r.group, best), ...(i === 0 && section.has_truth ? [behind] : [])]),
      ...(groups.some((g) => g.misleads != null) ? [{ title: "wrong above right [%]", hint: "how often the score misleads: of all pairs of a wrong and a right answer, the wrong one scores higher",
        value: (r) => r.group.misleads, of: (r) => number(r.group.misleads == null ? null : 100 * r.group.misleads, 0) }] : []),
    ]} /><//>`;
}

// Recall of each group with its interval, the best first.
function Forest({ section }) {
  const lines = section.groups.map((g, i) => ({ name: g.name, i, of: g.numbers.recall })).filter((l) => l.of)
    .sort((a, b) => b.of[0] - a.of[0]);
  const ends = lines.flatMap((l) => l.of).filter((x) => x != null);
  const low = Math.max(0, 10 * Math.floor((Math.min(...ends) - 1) / 10));
  const x = (v) => `${(100 * (v - low)) / (100 - low)}%`;
  return html`<div class="forest" role="img" aria-label="objects right, with 95 % intervals">
    ${lines.map(({ name, i, of: [value, from, to] }) => html`<span class="name"><${Swatch} color=${colorOf(i)} />${name}</span>
      <span class="track" title=${`${name}: ${number(value, 1)} %${from == null ? "" : `, 95 %: ${number(from, 1)} to ${number(to, 1)} %`}`}>
        <u style=${{ left: x(lines[0].of[0]) }} />
        ${from != null && html`<s style=${{ left: x(from), right: `calc(100% - ${x(to)})`, background: colorOf(i) }} />`}
        <i style=${{ left: x(value), background: colorOf(i) }} /></span>
      <b>${number(value, 1)} %</b>`)}
    <span /><span class="ends dim"><span>${low} %</span><span>objects right</span><span>100 %</span></span><span />
  </div>`;
}

// A chart that fills its place: what is drawn has coordinates from 0 to 100, lines keep their width and points are round.

const log = (v, low, high) => (100 * Math.log(Math.max(low, Math.min(high, v)) / low)) / Math.log(high / low);
const linear = (v, low, high) => (100 * (v - low)) / (high - low || 1);
function ticksOf(low, high) {
  const step = [1, 2, 5].flatMap((s) => [-2, -1, 0, 1, 2, 3, 4, 5].map((e) => s * 10 ** e)).sort((a, b) => a - b)
    .find((s) => (high - low) / s <= 6) ?? high - low;
  return Array.from({ length: Math.floor((high - low) / step + 1e-9) + 1 }, (_, i) => Number((low + i * step).toFixed(6)));
}
// x, y: { low, high, ticks, words, scale }; `onHover` gets the place of the pointer in both units of the drawing.
function Drawing({ x, y, children, onHover, square }) {
  const move = (e) => {
    const box = e.currentTarget.getBoundingClientRect();
    onHover?.([(100 * (e.clientX - box.left)) / box.width, (100 * (e.clientY - box.top)) / box.height]);
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
const axis = (words, low, high, scale = linear, ticks = ticksOf(low, high)) =>
  ({ words, ticks, at: (v) => scale(v, low, high) });
const pathOf = (xs, ys, x, y) => xs.map((v, i) => `${i ? "L" : "M"}${x.at(v).toFixed(2)} ${(100 - y.at(ys[i])).toFixed(2)}`).join("");
const Dot = ({ at: [u, v], color, hollow, onClick, children }) => html`<path class=${`point ${onClick ? "clickable" : ""}`}
  d=${`M${u.toFixed(2)} ${(100 - v).toFixed(2)}h0.001`} style=${{ stroke: color, opacity: hollow ? 0.45 : 0.85 }} onClick=${onClick}><title>${children}</title></path>`;

function Recall({ groups, thresholds, best }) {
  const [at, setAt] = useState(null);
  const [lit, setLit] = useState(null);
  const x = axis("error below [% of the diameter]", 0, thresholds.at(-1));
  const y = axis("objects [%]", 0, 100);
  const known = groups.map((g, i) => ({ ...g.curve, name: g.name, i })).filter((c) => c.recall);
  const banded = known.length <= MOST_BANDS ? known : known.filter((c) => c.i === (lit ?? best));
  const marked = at ?? thresholds.indexOf(LIMIT);
  return html`<${Drawing} x=${x} y=${y} onHover=${(p) => setAt(p && Math.max(0, Math.min(thresholds.length - 1,
      Math.round((p[0] / 100) * (thresholds.length - 1)))))}>
    ${banded.map((c) => c.low && html`<path class="band" style=${{ "--color": colorOf(c.i) }} d=${`${pathOf(thresholds, c.high, x, y)}${
      pathOf(thresholds, c.low, x, y).split(/(?=[ML])/).reverse().join("").replaceAll("M", "L")}Z`} />`)}
    <path class="limit" d=${`M${x.at(LIMIT)} 0V100`} />
    ${at != null && html`<path class="hover" d=${`M${x.at(thresholds[at])} 0V100`} />`}
    ${known.map((c) => html`<path class=${`curve ${lit != null && lit !== c.i ? "faint" : ""}`} stroke=${colorOf(c.i)}
      stroke-dasharray=${dashOf(c.i)} d=${pathOf(thresholds, c.recall, x, y)} />`)}
  <//>
  <div class="key"><span class="dim">below ${number(thresholds[marked], 1)} %:</span>${known.map((c) => html`
    <span onPointerEnter=${() => setLit(c.i)} onPointerLeave=${() => setLit(null)}><${Swatch} color=${colorOf(c.i)} />${known.length > 1
      ? c.name : ""} <b>${number(c.recall[marked], 1)} %</b>${c.low && html`<small class="dim">${interval([c.recall[marked],
        c.low[marked], c.high[marked]], 1)}</small>`}</span>`)}</div>`;
}

// A bar for each row, of parts: [words, value, colour]; all rows have one scale.
function Bars({ rows, unit, digits = 0, onPart }) {
  const sum = (parts) => parts.reduce((all, [, v]) => all + v, 0);
  const most = Math.max(...rows.map((r) => sum(r.parts)), 1e-9);
  return html`<div class="bars">${rows.map((r) => html`<span class="name">${r.name}</span>
    <span class="stack">${r.parts.filter(([, v]) => v > 0).map(([words, v, color]) => html`<i style=${{
      width: `${(100 * v) / most}%`, background: color }} class=${onPart ? "clickable" : ""} title=${`${words}: ${number(v, digits)} ${unit}`}
      onClick=${onPart && (() => onPart(words, r))} />`)}</span>
    <b>${r.words ?? `${number(sum(r.parts), digits)} ${unit}`}</b>`)}</div>`;
}

function Causes({ groups }) {
  const known = groups.filter((g) => g.causes.length);
  const all = [...new Set(known.flatMap((g) => g.causes.map(([title]) => title)))];
  const open = (title, runs) => showCards({ cause: title === "not explained" ? [] : [title], run: runs.length < state.answers.runs.length ? runs : [] });
  if (groups.length <= 2) {
    const count = (g, title) => g.causes.find(([t]) => t === title)?.[1] ?? 0;
    return html`${all.map((title) => html`<div class="cause"><button type="button" class="link" title="Show these answers"
      onClick=${() => open(title, groups.flatMap((g) => g.runs))}>${title}</button>
      <${Bars} unit="" rows=${groups.map((g, i) => ({ name: groups.length > 1 ? g.name : "", parts: [[g.name, count(g, title), colorOf(i)],
        ["", Math.max(...known.flatMap((o) => o.causes.map(([, n]) => n))) - count(g, title), "transparent"]], words: count(g, title) }))} /></div>`)}`;
  }
  const share = (g, n) => (100 * n) / Math.max(g.n_with_truth, 1);
  const color = (title) => (title === "not explained" ? "#98a3b5" : CAUSES[all.indexOf(title) % CAUSES.length]);
  return html`<${Bars} unit="%" digits=${1} rows=${groups.map((g) => ({ name: g.name, runs: g.runs,
      parts: g.causes.map(([title, n]) => [title, share(g, n), color(title)]) }))} onPart=${(title, r) => open(title, r.runs)} />
    <div class="key">${all.map((title) => html`<span><${Swatch} color=${color(title)} />${title}</span>`)}</div>`;
}

function Stages({ groups }) {
  const names = [...new Set(groups.flatMap((g) => Object.keys(g.stages)))];
  const [words, color] = [(s) => STAGES[s]?.[0] ?? s, (s) => STAGES[s]?.[1] ?? "#cccccc"];
  return html`<${Bars} unit="ms" rows=${groups.map((g) => ({ name: groups.length > 1 ? g.name : "",
      parts: names.map((s) => [words(s), g.stages[s] ?? 0, color(s)]) }))} />
    <div class="key">${names.map((s) => html`<span><${Swatch} color=${color(s)} />${words(s)}${groups.length <= 2
      && html`<b>${groups.map((g) => number(g.stages[s] ?? 0, 0)).join(" · ")}</b>`}</span>`)}</div>`;
}

function Grasps({ groups }) {
  const ends = [...new Set(groups.flatMap((g) => g.grasps.map(([end]) => end)))];
  const color = (end) => (end === "success" ? "#28a05a" : CAUSES[ends.indexOf(end) % CAUSES.length]);
  const bar = (name, g, i) => ({ name, parts: g.grasps.map((one) => [one[0], one[i], color(one[0])]) });
  const tried = groups.filter((g) => g.grasps.length);
  return html`<${Bars} unit="" rows=${[...tried.map((g) => bar(groups.length > 1 ? g.name : "answer", g, 1)), bar("ground truth", tried[0], 2)]} />
    <div class="key">${ends.map((end) => html`<span><${Swatch} color=${color(end)} />${end}</span>`)}</div>`;
}

// A table that a click on a head sorts. columns: those of `Table`, and `value(row)`, by which it sorts.
function Sorted({ name, columns, rows, most = 15 }) {
  const [by, setBy] = useState(null);
  const [isAll, setAll] = useState(false);
  const sorted = by == null ? rows : [...rows].sort((p, q) => {
    const [a, b] = [p, q].map(columns[by.column].value);
    if (a == null || b == null) return (a == null) - (b == null);
    return by.way * (typeof a === "string" ? a.localeCompare(b, "en", { numeric: true }) : a - b);
  });
  const head = (c, i) => (c.value ? html`<button type="button" class="link sort" title=${c.hint ?? "sort"} onClick=${() =>
    setBy({ column: i, way: by?.column === i ? -by.way : c.left ? 1 : -1 })}>${c.title}${by?.column === i ? (by.way < 0 ? " ↓" : " ↑") : ""}</button>` : c.title);
  return html`<div class="scroll" data-table=${name}><${Table} rows=${isAll ? sorted : sorted.slice(0, most)}
      columns=${columns.map((c, i) => ({ ...c, title: head(c, i), of: c.of ?? ((r) => c.value(r)) }))} />
    ${!isAll && rows.length > most && html`<button type="button" class="link more" onClick=${() => setAll(true)}>All ${rows.length}</button>`}</div>`;
}

function Objects({ section: { groups, objects, has_truth } }) {
  const named = [
    { title: "id", value: (o) => o.id },
    { title: "object", left: true, value: (o) => o.name, of: (o) => html`<button type="button" class="link" title="Show its answers"
      onClick=${() => showCards({ object: [o.name] })}>${o.name}</button>` },
  ];
  if (groups.length > 2 && has_truth) {
    const cell = (c) => (c?.right == null ? "–" : html`<span class="heat" title=${`${c.n} answers`}
      style=${{ background: `hsl(${1.2 * c.right} 60% 45% / 0.4)` }}>${number(c.right, 0)}</span>`);
    return html`<${Block} title="Object by object" hint="right [%]" wide><${Sorted} name="objects" rows=${objects}
      columns=${[...named, ...groups.map((g, i) => ({ title: g.name, value: (o) => o.cells[i]?.right, of: (o) => cell(o.cells[i]) }))]} /><//>`;
  }
  const values = [["right", "right [%]", 0], ["ar", "BOP AR [%]", 1], ["median_mm", "median ADD(-S) [mm]", 1], ["score", "score", 2]]
    .filter(([id]) => objects.some((o) => o.cells.some((c) => c?.[id] != null)));
  const causes = objects.some((o) => o.cells.some((c) => c?.cause));
  return html`<${Block} title="Object by object" hint=${groups.length > 1 ? groups.map((g) => g.name).join(" → ") : ""} wide>
    <${Sorted} name="objects" rows=${objects} columns=${[...named, { title: "answers", value: (o) => Math.max(...o.cells.map((c) => c?.n ?? 0)) },
      ...values.map(([id, title, digits]) => ({ title, value: (o) => o.cells[0]?.[id],
        of: (o) => o.cells.map((c) => number(c?.[id], digits)).join(" → ") })),
      ...(causes ? [{ title: "most frequent cause", left: true, value: (o) => o.cells.map((c) => c?.cause).filter(Boolean)[0] }] : []),
    ]} /><//>`;
}

function Hardest({ section: { hardest, n_hard } }) {
  return html`<${Block} wide title="Hardest objects" hint=${`wrong in most groups with most seeds${n_hard > hardest.length
      ? `; ${hardest.length} of ${n_hard}` : ""}`}><${Sorted} name="hardest" rows=${hardest} columns=${[
    { title: "frame", left: true, value: (h) => h.frame, of: (h) => html`<${Answer} of=${h.key}>${h.frame}<//>` },
    { title: "object", left: true, value: (h) => h.name },
    { title: "groups wrong", value: (h) => h.wrong_groups, of: (h) => `${h.wrong_groups} of ${h.groups}` },
    { title: "right", hint: "of all groups and seeds", value: (h) => h.right / h.n, of: (h) => `${h.right} of ${h.n}` },
    { title: "best group", left: true, value: (h) => h.best?.[0] ?? "", of: (h) => (h.best ? `${h.best[0]}: ${h.best[1]} of ${h.best[2]}` : "none is ever right") },
    { title: "most frequent cause", left: true, value: (h) => h.cause },
  ]} /><//>`;
}

// Two runs, object by object.
function Change({ change, groups: [a, b] }) {
  const { objects } = change;
  const ends = [0.1, 200];
  const ticks = [0.1, 1, 10, 100];
  const [x, y] = [a, b].map((g) => axis(`error, ${g.name} [% of the diameter]`, ...ends, log, ticks));
  const same = (o) => o.by != null && Math.abs(o.by) <= change.same;
  const color = (o) => (same(o) ? "var(--faint)" : o.errors[1] == null || o.by > 0 ? "var(--bad)" : "var(--good)");
  const words = (o) => `${o.name} in ${o.frame}: ${percent(o.errors[0])} → ${percent(o.errors[1])} %`;
  // The worse of the two is what there is to look at.
  const worse = (o) => o.keys[o.errors[1] == null || (o.errors[0] != null && o.by > 0) ? 1 : 0];
  const known = objects.filter((o) => o.errors.every((e) => e != null));
  const rank = (o) => (o.by != null ? o.by : o.errors[1] == null ? (o.errors[0] == null ? 0 : Infinity) : -Infinity);
  const better = objects.filter((o) => rank(o) < -change.same);
  const worsened = objects.filter((o) => rank(o) > change.same).reverse();
  const list = (name, rows) => html`<div><h3>${name} <span class="dim">${rows.length}</span></h3>
    ${rows.length > 0 && html`<${Sorted} name=${name} most=${8} rows=${rows} columns=${[
      { title: "frame", left: true, value: (o) => o.frame, of: (o) => html`<${Answer} of=${worse(o)}>${o.frame}<//>` },
      { title: "object", left: true, value: (o) => o.name },
      { title: "A [%]", hint: "error, of the diameter", value: (o) => o.errors[0], of: (o) => percent(o.errors[0]) },
      { title: "B [%]", hint: "error, of the diameter", value: (o) => o.errors[1], of: (o) => percent(o.errors[1]) },
      { title: "change", value: rank, of: (o) => html`<span class=${toneOf(rank(o), -1)}>${o.by == null ? "" : signed(o.by)}</span>` },
      { title: "", left: true, of: (o) => o.turned && html`<span class=${o.turned === "right" ? "good" : "bad"}>now ${o.turned}</span>` },
    ]} />`}</div>`;
  const counts = [["better", change.better, "good"], ["worse", change.worse, "bad"], ["became right", change.now_right, "good"],
    ["became wrong", change.now_wrong, "bad"], ["both wrong", change.both_wrong, ""], [`only in ${a.name}`, change.only[0], ""],
    [`only in ${b.name}`, change.only[1], ""]].filter(([, n], i) => n || i < 4);
  const compared = (words) => showCards({ compared: [words] });
  return html`<${Block} wide title="Object by object, both runs" hint=${`${change.n} objects`}>
    <div class="counts">${counts.map(([words, n, tone]) => html`<span><b class=${n ? tone : ""}>${n}</b> ${words}</span>`)}
      ${[`only ${a.name} wrong`, `only ${b.name} wrong`, "both wrong"].filter((w) => state.answers?.rows.some((r) => r.compared === w))
        .map((w) => html`<button type="button" class="link" onClick=${() => compared(w)}>${w}</button>`)}</div>
    <div class="change">
      <${Drawing} x=${x} y=${y} square>
        <path class="limit" d=${`M0 100L100 0M${x.at(LIMIT)} 0V100M0 ${100 - y.at(LIMIT)}H100`} />
        ${known.map((o) => html`<${Dot} at=${[x.at(o.errors[0]), y.at(o.errors[1])]} color=${color(o)} hollow=${same(o)}
          onClick=${() => openAnswer(rowOf(worse(o)))}>${words(o)}<//>`)}<//>
      ${list("Got better", better)}${list("Got worse", worsened)}
    </div>
    ${change.frames.length > 1 && html`<h3>Frame by frame</h3><${Sorted} name="frames" most=${8} rows=${change.frames} columns=${[
      { title: "frame", left: true, value: (f) => f.frame },
      ...[0, 1].flatMap((i) => [
        { title: `mean error ${"AB"[i]} [%]`, hint: "over objects that both have an answer for, of the diameter", value: (f) => f.errors[i], of: (f) => number(f.errors[i], 1) },
        { title: `right ${"AB"[i]}`, value: (f) => f.right[i], of: (f) => `${f.right[i]} of ${f.n}` }]),
    ]} />`}<//>`;
}

function Tracks({ tracks }) {
  const drawn = tracks.filter((t) => t.moved.length);
  const points = drawn.flatMap((t) => t.moved);
  const [low, high] = [Math.min(...points.map((p) => p[0])), Math.max(...points.map((p) => p[0]))];
  const x = axis("frame", low, high);
  const y = axis("moved since the frame before [mm]", 0, Math.max(...points.map((p) => p[1]), 1));
  const names = new Set(tracks.map((t) => t.run)).size > 1 ? [{ title: "run", left: true, value: (t) => t.run }] : [];
  return html`<${Block} wide title="From frame to frame" hint="flip: turned by more than 30° to a pose that nearly looks the same; jump: otherwise, or moved by more than 50 mm">
    <${Sorted} name="motion" rows=${tracks} columns=${[{ title: "object", left: true, value: (t) => t.name }, ...names,
      { title: "scene", value: (t) => t.scene }, { title: "frames", value: (t) => t.frames },
      { title: "flips", value: (t) => t.flips, of: (t) => html`<span class=${t.flips ? "bad" : ""}>${t.flips}</span>` },
      { title: "per 100 frames", value: (t) => t.per_100, of: (t) => number(t.per_100, 1) },
      { title: "jumps", value: (t) => t.jumps, of: (t) => html`<span class=${t.jumps ? "bad" : ""}>${t.jumps}</span>` },
      { title: "no pose", value: (t) => t.no_pose },
      { title: "mm a frame", hint: "median of the frames that neither flip nor jump", value: (t) => t.mm, of: (t) => number(t.mm, 1) },
      { title: "° a frame", hint: "median of the frames that neither flip nor jump", value: (t) => t.deg, of: (t) => number(t.deg, 1) },
      { title: "drift [mm]", hint: "from the first pose to the last, in the world", value: (t) => t.drift_mm, of: (t) => number(t.drift_mm, 1) }]} />
    ${points.length > 1 && html`<${Drawing} x=${x} y=${y}>${drawn.map((t, i) => html`<path class="curve" stroke=${colorOf(i)}
        d=${pathOf(t.moved.map((p) => p[0]), t.moved.map((p) => p[1]), x, y)} />
        ${t.moved.filter((p) => p[3] !== "moved").map((p) => html`<${Dot} at=${[x.at(p[0]), y.at(p[1])]} color="var(--bad)">${t.name} in
          frame ${p[0]}: ${p[3]}, turned ${number(p[2], 0)}°<//>`)}`)}<//>
      <div class="key">${drawn.map((t, i) => html`<span><${Swatch} color=${colorOf(i)} />${t.name}</span>`)}</div>`}<//>`;
}

function Made({ section: { groups, differing } }) {
  return html`<div class="made">
    ${differing.length > 0 && html`<details><summary>What differs among the settings</summary>
      <div class="scroll"><${Table} rows=${differing} columns=${[{ title: "setting", left: true, of: ([name]) => name },
        ...groups.map((g, i) => ({ title: g.name, left: true, of: ([, values]) => values[i] }))]} /></div></details>`}
    ${groups.map((g) => html`<details><summary>Session of ${g.name} <span class="dim">${g.made.join(" · ")}</span></summary>
      <pre>${g.session}</pre></details>`)}
  </div>`;
}
