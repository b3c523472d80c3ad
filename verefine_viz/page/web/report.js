// The report of batches: what came out, how sure that is, why answers are wrong, and all of them as cards below.
import { html } from "htm/preact";
import { state, useStore, on, update } from "./store.js";
import { palette } from "./palette.js";
import { Button, columnsOf, Icon, IconButton, Swatch, Table, number } from "./ui.js";
import { choose, openAnswer } from "./answers.js";
import { Gallery } from "./gallery.js";
import { Plot, plotTitle } from "./gallery_plot.js";
import { RemedyTable } from "./remedies.js";
import { addKeys, titled } from "./keys.js";
import { applyTheme, presets, setPreset, switchTheme } from "./layout.js";
import { Bars, Dot, Drawing, Forest, Key, limit, Recall, Sorted, axis, colorOf, interval, log, pathOf,
  signed } from "./report_charts.js";

/** @import { ApartAnswers, FrameChange, HardObject, ObjectCell, ObjectChange, ObjectNumbers, PairDifference, ReportColumn, ReportGroup, ReportMessage, ReportSection, ReportTrack } from "./messages.d.ts" */

/** @import { Column } from "./ui.js" */
/** @typedef {Exclude<keyof ReportTrack, "run" | "name" | "moved">} Counted  of a track */

/** @type {Record<string, string>} */
const STAGES = {
  read: "read", prepare: "prepare models, once", compile: "compile, once", start: "hypotheses", refine: "refine",
  simulate: "simulate", score: "score", rest: "rest of the iterations", grasp: "grasp", explain: "look for causes",
  summarise: "summarise", record: "record",
};
const UNEXPLAINED = "not explained";
const causeColor = (i) => palette.causes[i % palette.causes.length];

on("report", (report) => {
  update({ report });
  setPreset("report");
  addKeys([{ id: "report", keys: ["r"], title: "Report", group: "Show", action: () => setPreset("report") }]);
});
addEventListener("beforeprint", () => (document.documentElement.dataset.theme = "light"));
addEventListener("afterprint", applyTheme);

const rowOf = (/** @type {number} */ key) => state.answers?.rows[key];
const Link = ({ title, onClick, children }) => html`
  <button type="button" class="link" title=${title} onClick=${onClick}>${children}</button>`;
const Answer = ({ of, children }) => html`
  <${Link} title="Open this answer" onClick=${() => openAnswer(rowOf(of))}>${children}<//>`;
function showCards(only) {
  choose({ only, search: "", at: null });
  document.querySelector(".report .gallery").scrollIntoView({ behavior: "smooth" });
}
const percent = (x) => (x == null ? "none" : number(x, 1));
// Whether a change is for the better, as a class.
/** @type {(by: number | null, better: number, digits?: number) => string} */
const toneOf = (by, better, digits = 1) =>
  (by == null || !better || Number(by.toFixed(digits)) === 0 ? "" : by * better > 0 ? "good" : "bad");
// In front of what is of one group, where there are several.
/** @type {(groups: ReportGroup[], g: ReportGroup) => string} */
const nameIn = (groups, g) => (groups.length > 1 ? g.name : "");

export function Report() {
  const [report, theme, preset, answers] = useStore((s) => [s.report, s.theme, s.view.preset, s.answers, s.frame]);
  const { sections } = report;
  const several = sections.length > 1;
  const doubts = [...sections.map((s) => s.doubt), ...report.notes].filter(Boolean);
  const height = `min(100vh - 6rem, ${12 + 17 * Math.ceil((answers?.rows.length ?? 0) / 5)}rem)`;
  return html`<div class="report-all">
    <header class="report-head">
      <div><h1>${report.title}</h1>
        <p class="dim">${[report.session_title, report.counted].filter(Boolean).join(" · ")}</p></div>
      <nav class="presets" aria-label="Layout">${presets(state).map((p) => html`<${Button} on=${p.id === preset}
        title=${p.hint} onClick=${() => setPreset(p.id)}>${p.title}<//>`)}</nav>
      <${IconButton} icon=${theme === "light" ? "moon" : "sun"} title=${titled("theme")} onClick=${switchTheme} />
    </header>
    ${doubts.map((words) => html`<p class="warning"><${Icon} name="warn" />${words}</p>`)}
    ${several && html`<${Overview} report=${report} />`}
    ${report.fix && html`<${Block} title="Remedies that were tried" hint="on answers of their causes, and on answers that are right">
      <div class="scroll"><${RemedyTable} shown=${report.fix} /></div><//>`}
    ${sections.map((section, i) => html`
      <${Section} key=${i} id=${`data-${i}`} section=${section} report=${report} isNamed=${several} />`)}
    <section class="pane gallery" style=${{ height }}><${Gallery} /></section>
    ${report.left_out.length > 0 && html`<section class="block"><h2>Left out</h2>
      ${report.left_out.map(([run, why]) => html`<p><b>${run}</b> ${why}</p>`)}</section>`}
  </div>`;
}

/**
 * @template R
 * @param {ReportColumn} c
 * @param {(row: R) => ReportGroup} groupOf
 * @param {(c: ReportColumn) => number | null} [best]
 * @returns {Column<R>}
 */
const numberColumn = (c, groupOf, best) => ({
  title: `${c.label}${c.unit ? ` [${c.unit}]` : ""}`, hint: c.hint, value: (r) => groupOf(r).numbers[c.id]?.[0],
  of: (r) => {
    const mine = groupOf(r).numbers[c.id];
    if (!mine) return "–";
    const words = number(mine[0], c.digits);
    return html`${mine[0] === best?.(c) ? html`<b>${words}</b>` : words}<small>${interval(mine, c.digits)}</small>`;
  },
});

/**
 * All sets of data: what cannot be compared stands side by side.
 * @param {{ report: ReportMessage }} props
 */
function Overview({ report }) {
  const rows = report.sections.flatMap((section, i) => section.groups.map((group) => ({ section, group, i })));
  const isKnown = (/** @type {{ section: ReportSection }} */ { section }) => section.has_truth;
  const columns = report.columns.filter((c) => (c.better || (!rows.every(isKnown) && ["score", "undetermined_mm"].includes(c.id)))
    && rows.some(({ group }) => group.numbers[c.id]));
  const show = (/** @type {number} */ i) => document.getElementById(`data-${i}`).scrollIntoView({ behavior: "smooth" });
  return html`<${Block} title="Side by side" hint="each by its own data">
    <${Sorted} name="overview" rows=${rows} columns=${columnsOf(rows, [
      { title: "data", left: true, value: (r) => r.section.data,
        of: (r) => html`<${Link} title="Show its numbers" onClick=${() => show(r.i)}>${r.section.data}<//>` },
      { title: "group", left: true, value: (r) => r.group.name },
      { title: "objects", value: (r) => r.group.n_objects },
      ...columns.map((c) => numberColumn(c, (/** @type {typeof rows[number]} */ r) => r.group)),
    ])} /><//>`;
}

const Block = ({ title, hint, wide, children }) => html`<section class=${`block ${wide ? "wide" : ""}`}>
  <h2>${title} ${hint && html`<span class="dim">${hint}</span>`}</h2>${children}</section>`;

/** @param {{ id: string, section: ReportSection, report: ReportMessage, isNamed: boolean }} props */
function Section({ id, section, report, isNamed }) {
  const { groups } = section;
  const columns = report.columns.filter((c) => groups.some((g) => g.numbers[c.id]));
  const basis = [section.intervals, section.bop,
    groups.length > 1 && !section.same_objects ? "Not all runs have the same objects." : "",
    section.has_truth ? "" : "No ground truth: errors, recall and BOP scores are not known."];
  const { next } = section;
  return html`<section class="data" id=${id}>
    ${isNamed && html`<h2 class="name">${section.data} <span class="dim">${section.session_title}</span></h2>`}
    <p class="lead">${section.headline}</p>
    ${next && html`<p class="next">${groups.length > 1 && html`<b>${groups[next.group].name}: </b>`}
      ${next.text} <${Answer} of=${next.key}>${next.begin}<//>.</p>`}
    ${groups.length <= 2 && html`<${Tiles} columns=${columns} groups=${groups} />`}
    ${groups.length > 1 && html`<${Groups} section=${section} columns=${columns} />`}
    <p class="basis dim">${basis.filter(Boolean).join(" ")}</p>
    <${Blocks} section=${section} report=${report} />
    <${Made} section=${section} />
  </section>`;
}

/** @param {{ section: ReportSection, report: ReportMessage }} props */
function Blocks({ section, report }) {
  const { groups } = section;
  const runs = new Set(groups.flatMap((g) => g.runs));
  const rows = useStore((s) => s.answers)?.rows.filter((row) => runs.has(row.run));
  return html`<div class="blocks">
    ${groups.some((g) => g.causes.length) && html`<${Block} title="Why answers are wrong">
      <${Causes} groups=${groups} /><//>`}
    ${section.has_truth && html`<${Block} title="Recall" hint="share of objects whose ADD(-S) is below a limit">
      <${Recall} groups=${groups} thresholds=${report.thresholds} best=${section.best} /><//>`}
    ${plotTitle(rows ?? []) && html`<${Block} title=${plotTitle(rows)}>
      <${Plot} of=${rows} />${groups.length <= 2 && groups.map((g) => html`<${Misleads} groups=${groups} of=${g} />`)}
      <//>`}
    ${groups.some((g) => Object.keys(g.stages).length) && html`<${Block} title="Time by stage" hint="mean of a frame, with reading and recording">
      <${Stages} groups=${groups} /><//>`}
    ${groups.some((g) => g.grasps.length) && html`<${Block} title="How grasps end">
      <${Grasps} groups=${groups} /><//>`}
    ${section.apart.length > 0 && html`<${Apart} rows=${section.apart} />`}
    ${section.change && html`<${Change} change=${section.change} groups=${groups} />`}
    <${Objects} section=${section} />
    ${section.hardest.length > 0 && html`<${Hardest} section=${section} />`}
    ${section.tracks.length > 0 && html`<${Tracks} tracks=${section.tracks} />`}
  </div>`;
}

/** @param {{ groups: ReportGroup[], of: ReportGroup }} props */
const Misleads = ({ groups, of }) => of.misleads != null && html`<p class="dim">${groups.length > 1
  ? `${of.name}: w` : "W"}rong scores above right in ${number(100 * of.misleads, 0)} % of pairs.</p>`;

/** @param {{ columns: ReportColumn[], groups: ReportGroup[] }} props */
function Tiles({ columns, groups: [a, b] }) {
  return html`<div class=${`tiles ${b ? "of-two" : ""}`}>${columns.map((c) => {
    const [mine, theirs] = [a.numbers[c.id], b?.numbers[c.id]];
    const by = mine && theirs ? theirs[0] - mine[0] : null;
    /** @param {ReportGroup["numbers"][string] | undefined} one */
    const words = (one) => (one ? number(one[0], c.digits) : "–");
    const ends = mine && !b ? interval(mine, c.digits) : "";
    return html`<div class="tile" title=${c.hint}><span class="dim">${c.label}</span>
      <b>${words(mine)}${b && html`<span class="dim"> → </span>${words(theirs)}`}<small>${c.unit}</small></b>
      ${by != null && html`<span class=${toneOf(by, c.better, c.digits)}>${signed(by, c.digits)}</span>`}
      ${ends && html`<span class="dim">${ends}</span>`}</div>`;
  })}</div>`;
}

/**
 * A line for each group: numbers with intervals, the best of a column in bold.
 * @param {{ section: ReportSection, columns: ReportColumn[] }} props
 */
function Groups({ section, columns }) {
  const { groups } = section;
  const best = (/** @type {ReportColumn} */ c) => {
    const all = groups.map((g) => g.numbers[c.id]?.[0]).filter((x) => x != null);
    return c.better && new Set(all).size > 1 ? (c.better > 0 ? Math.max(...all) : Math.min(...all)) : null;
  };
  const rows = groups.map((group, i) => ({ group, i }));
  /** @typedef {typeof rows[number]} Row */
  const recall = (/** @type {Row} */ r) => r.group.numbers.recall?.[0] ?? 0;
  if (!section.change) rows.sort((p, q) => recall(q) - recall(p));
  /** @type {Column<Row>} */
  const behind = {
    title: "against the best", hint: "difference in right objects, in points, over the objects that both have",
    value: (r) => r.group.behind?.[0] ?? 0,
    of: ({ group, i }) => {
      if (!group.behind) return i === section.best ? "best" : "–";
      const [by, low, high] = group.behind;
      return html`<span class=${low > 0 || high < 0 ? toneOf(by, 1) : ""}>${signed(by)}</span>
        <small>${interval(group.behind, 1, signed)}</small>`;
    },
  };
  /** @type {Column<Row>} */
  const misleads = {
    title: "wrong above right [%]",
    hint: "how often the score misleads: pairs of a wrong and a right answer in which the wrong one scores higher",
    value: (r) => r.group.misleads, of: (r) => number(r.group.misleads == null ? null : 100 * r.group.misleads, 0),
  };
  return html`<${Block} title="Group by group" wide>
    ${section.has_truth && html`<${Forest} groups=${groups} />`}
    <${Sorted} name="groups" rows=${rows} columns=${columnsOf(rows, [
      { title: "group", left: true, value: (r) => r.group.name,
        of: ({ group, i }) => html`<${Swatch} color=${colorOf(i)} />${group.name}` },
      { title: "runs", hint: "they differ in their seeds only", value: (r) => r.group.runs.length },
      ...columns.flatMap((c) => [numberColumn(c, (/** @type {Row} */ r) => r.group, best), ...(c.id === "recall" ? [behind] : [])]),
      ...(groups.length > 2 && groups.some((g) => g.misleads != null) ? [misleads] : []),
    ])} /><//>`;
}

/** @param {{ groups: ReportGroup[] }} props */
function Causes({ groups }) {
  const all = [...new Set(groups.flatMap((g) => g.causes.map(([title]) => title)))];
  /** @type {(title: string, runs: string[]) => void} */
  const show = (title, runs) => showCards({ cause: title === UNEXPLAINED ? [] : [title],
    run: runs.length < state.answers.runs.length ? runs : [] });
  if (groups.length <= 2) {
    /** @type {(g: ReportGroup, title: string) => number} */
    const count = (g, title) => g.causes.find(([t]) => t === title)?.[1] ?? 0;
    const most = Math.max(...groups.flatMap((g) => g.causes.map(([, n]) => n)));
    const bars = (/** @type {string} */ title) => groups.map((g, i) =>
      ({ name: nameIn(groups, g), parts: [[g.name, count(g, title), colorOf(i)]] }));
    return all.map((title) => html`<div class="cause">
      <${Link} title="Show these answers" onClick=${() => show(title, groups.flatMap((g) => g.runs))}>${title}<//>
      <${Bars} rows=${bars(title)} most=${most} /></div>`);
  }
  /** @param {string} title */
  const color = (title) => (title === UNEXPLAINED ? palette.times.rest : causeColor(all.indexOf(title)));
  /** @type {(g: ReportGroup, n: number) => number} */
  const share = (g, n) => (100 * n) / Math.max(g.n_with_truth, 1);
  const parts = (/** @type {ReportGroup} */ g) => g.causes.map(([title, n]) => [title, share(g, n), color(title)]);
  return html`<${Bars} unit="%" digits=${1} onPart=${(title, r) => show(title, r.runs)}
      rows=${groups.map((g) => ({ name: g.name, runs: g.runs, parts: parts(g) }))} />
    <${Key} of=${all.map((title) => [title, color(title)])} />`;
}

/** @param {{ groups: ReportGroup[] }} props */
function Stages({ groups }) {
  const names = [...new Set(groups.flatMap((g) => Object.keys(g.stages)))];
  const styled = names.map((name) => [STAGES[name] ?? name, palette.times[name] ?? palette.times.rest]);
  /** @type {(g: ReportGroup, name: string) => number} */
  const ms = (g, name) => g.stages[name] ?? 0;
  const parts = (/** @type {ReportGroup} */ g) => names.map((name, i) => [styled[i][0], ms(g, name), styled[i][1]]);
  /** @param {string} name */
  const values = (name) => (groups.length <= 2 ? groups.map((g) => number(ms(g, name), 0)).join(" · ") : null);
  return html`<${Bars} unit="ms" rows=${groups.map((g) => ({ name: nameIn(groups, g), parts: parts(g) }))} />
    <${Key} of=${names.map((name, i) => [...styled[i], values(name)])} />`;
}

/** @param {{ groups: ReportGroup[] }} props */
function Grasps({ groups }) {
  const tried = groups.filter((g) => g.grasps.length);
  const ends = [...new Set(tried.flatMap((g) => g.grasps.map(([end]) => end)))];
  const color = (/** @type {string} */ end) => (end === "success" ? palette.marks.best : causeColor(ends.indexOf(end)));
  /** @type {(name: string, g: ReportGroup, i: 1 | 2) => object} */
  const bar = (name, g, i) => ({ name, parts: g.grasps.map((one) => [one[0], one[i], color(one[0])]) });
  const answers = tried.map((g) => bar(groups.length > 1 ? g.name : "answer", g, 1));
  return html`<${Bars} rows=${[...answers, bar("ground truth", tried[0], 2)]} />
    <${Key} of=${ends.map((end) => [end, color(end)])} />`;
}

/** @param {{ section: ReportSection }} props */
function Objects({ section: { groups, objects, has_truth } }) {
  /** @type {Column<ObjectNumbers>[]} */
  const named = [
    { title: "id", value: (o) => o.id },
    { title: "object", left: true, value: (o) => o.name, of: (o) => html`
      <${Link} title="Show its answers" onClick=${() => showCards({ object: [o.name] })}>${o.name}<//>` },
  ];
  if (groups.length > 2 && has_truth) {
    /** @param {ObjectCell | null} c */
    const cell = (c) => (c?.right == null ? "–" : html`<span class="heat" title=${`${c.n} answers`}
      style=${{ background: `hsl(${1.2 * c.right} 60% 45% / 0.4)` }}>${number(c.right, 0)}</span>`);
    /** @type {(g: ReportGroup, i: number) => Column<ObjectNumbers>} */
    const column = (g, i) => ({ title: g.name, value: (o) => o.cells[i]?.right, of: (o) => cell(o.cells[i]) });
    return html`<${Block} title="Object by object" hint="right [%]" wide>
      <${Sorted} name="objects" rows=${objects} columns=${[...named, ...groups.map(column)]} /><//>`;
  }
  /** @param {keyof ObjectCell} id */
  const has = (id) => objects.some((o) => o.cells.some((c) => c?.[id] != null && c[id] !== ""));
  /** @type {[keyof ObjectCell, string, number][]} */
  const numbers = [["right", "right [%]", 0], ["ar", "BOP AR [%]", 1], ["median_mm", "median ADD(-S) [mm]", 1],
    ["score", "score", 2], ["undetermined_mm", "undetermined [mm]", 1]];
  const values = numbers.filter(([id]) => has(id));
  const hint = groups.length > 1 ? groups.map((g) => g.name).join(" → ") : "";
  return html`<${Block} title="Object by object" hint=${hint} wide>
    <${Sorted} name="objects" rows=${objects} columns=${columnsOf(objects, [...named,
      { title: "answers", value: (o) => Math.max(...o.cells.map((c) => c?.n ?? 0)) },
      ...values.map(([id, title, digits]) => ({ title, value: (o) => o.cells[0]?.[id],
        of: (o) => o.cells.map((c) => number(c?.[id], digits)).join(" → ") })),
      ...(has("cause") ? [{ title: "most frequent cause", left: true,
        value: (o) => o.cells.map((c) => c?.cause).find(Boolean) ?? "" }] : []),
    ])} /><//>`;
}

/** @param {{ section: ReportSection }} props */
function Hardest({ section: { hardest, n_hard } }) {
  const more = n_hard > hardest.length ? `; ${hardest.length} of ${n_hard}` : "";
  /** @param {HardObject} h */
  const best = (h) => (h.best ? `${h.best[0]}: ${h.best[1]} of ${h.best[2]}` : "none is ever right");
  return html`<${Block} wide title="Hardest objects" hint=${`wrong in most groups with most seeds${more}`}>
    <${Sorted} name="hardest" rows=${hardest} columns=${columnsOf(hardest, [
      { title: "frame", left: true, value: (h) => h.frame, of: (h) => html`<${Answer} of=${h.key}>${h.frame}<//>` },
      { title: "object", left: true, value: (h) => h.name },
      { title: "groups wrong", value: (h) => h.wrong_groups, of: (h) => `${h.wrong_groups} of ${h.groups}` },
      { title: "right", hint: "of all groups and seeds", value: (h) => h.right / h.n,
        of: (h) => `${h.right} of ${h.n}` },
      { title: "best group", left: true, value: best },
      { title: "most frequent cause", left: true, value: (h) => h.cause },
    ])} /><//>`;
}

/**
 * Two runs of which no error is known: where their answers are not the same.
 * @param {{ rows: ApartAnswers[] }} props
 */
const Apart = ({ rows }) => html`<${Block} wide title="How far the answers are apart" hint=${`${rows.length} objects`}>
  <${Sorted} name="apart" rows=${rows} columns=${columnsOf(rows, [
    { title: "frame", left: true, value: (o) => o.frame },
    { title: "object", left: true, value: (o) => o.name },
    { title: "moved [mm]", hint: "of the model's middle, from A to B", value: (o) => o.mm, of: (o) => number(o.mm, 1) },
    { title: "turned [°]", hint: "as it is, also where the shape looks the same after the turn", value: (o) => o.deg,
      of: (o) => number(o.deg, 1) },
    ...["A", "B"].map((side, i) => ({ title: `score ${side}`, hint: "opens this answer",
      value: (/** @type {ApartAnswers} */ o) => o.scores[i], of: (/** @type {ApartAnswers} */ o) => html`<${Answer} of=${o.keys[i]}>${number(o.scores[i], 2)}<//>` })),
  ])} /><//>`;

/**
 * Two runs, object by object.
 * @param {{ change: PairDifference, groups: ReportGroup[] }} props
 */
function Change({ change, groups: [a, b] }) {
  const [x, y] = [a, b].map((g) => axis(`error, ${g.name} [% of the diameter]`, 0.1, 200, log, [0.1, 1, 10, 100]));
  // By how much B is worse; without an answer there is no telling.
  /** @param {ObjectChange} o */
  const rank = (o) => o.by ?? (o.errors[1] != null ? -Infinity : o.errors[0] != null ? Infinity : 0);
  const isSame = (/** @type {ObjectChange} */ o) => Math.abs(rank(o)) <= change.same;
  /** @param {ObjectChange} o */
  const color = (o) => (isSame(o) ? "var(--faint)" : rank(o) > 0 ? "var(--bad)" : "var(--good)");
  const words = (/** @type {ObjectChange} */ o) => `${o.name} in ${o.frame}: ${o.errors.map(percent).join(" → ")} %`;
  const worse = (/** @type {ObjectChange} */ o) => o.keys[rank(o) > 0 ? 1 : 0]; // there is more to look at
  const known = change.objects.filter((o) => o.errors.every((e) => e != null));
  /** @type {(title: string, rows: ObjectChange[]) => unknown} */
  const list = (title, rows) => html`<div><h3>${title} <span class="dim">${rows.length}</span></h3>
    ${rows.length > 0 && html`<${Sorted} name=${title} most=${8} rows=${rows} columns=${columnsOf(rows, [
      { title: "frame", left: true, value: (o) => o.frame, of: (o) => html`<${Answer} of=${worse(o)}>${o.frame}<//>` },
      { title: "object", left: true, value: (o) => o.name },
      ...["A [%]", "B [%]"].map((title, i) => ({ title, hint: "error, of the diameter",
        value: (/** @type {ObjectChange} */ o) => o.errors[i], of: (/** @type {ObjectChange} */ o) => percent(o.errors[i]) })),
      { title: "change", value: rank, of: (o) => o.by != null && html`
        <span class=${toneOf(o.by, -1)}>${signed(o.by)}</span>` },
      { title: "now", hint: "what it became in B", left: true, value: (o) => o.turned, of: (o) => o.turned && html`
        <span class=${o.turned === "right" ? "good" : "bad"}>${o.turned}</span>` },
    ])} />`}</div>`;
  const counts = [["better", change.better, "good"], ["worse", change.worse, "bad"],
    ["became right", change.now_right, "good"], ["became wrong", change.now_wrong, "bad"],
    ["both wrong", change.both_wrong, ""], [`only in ${a.name}`, change.only[0], ""],
    [`only in ${b.name}`, change.only[1], ""]].filter(([, n], i) => n || i < 4);
  const kinds = [`only ${a.name} wrong`, `only ${b.name} wrong`, "both wrong"]
    .filter((kind) => state.answers?.rows.some((r) => r.compared === kind));
  return html`<${Block} wide title="Object by object, both runs" hint=${`${change.n} objects`}>
    <div class="counts">
      ${counts.map(([words, n, tone]) => html`<span><b class=${n ? tone : ""}>${n}</b> ${words}</span>`)}
      ${kinds.map((kind) => html`<${Link} title="Show these answers"
        onClick=${() => showCards({ compared: [kind] })}>${kind}<//>`)}</div>
    <div class="pair-change">
      <${Drawing} x=${x} y=${y} square>
        <path class="limit" d=${`M0 100L100 0M${x.at(limit())} 0V100M0 ${100 - y.at(limit())}H100`} />
        ${known.map((o) => html`<${Dot} at=${[x.at(o.errors[0]), y.at(o.errors[1])]} color=${color(o)}
          faint=${isSame(o)} onClick=${() => openAnswer(rowOf(worse(o)))}>${words(o)}<//>`)}
      <//>
      ${list("Got better", change.objects.filter((o) => rank(o) < -change.same))}
      ${list("Got worse", change.objects.filter((o) => rank(o) > change.same).reverse())}
    </div>
    ${change.frames.length > 1 && html`<h3>Frame by frame</h3>
      <${Sorted} name="frames" most=${8} rows=${change.frames} columns=${columnsOf(change.frames, [
        { title: "frame", left: true, value: (f) => f.frame },
        ...["A", "B"].flatMap((side, i) => [
          { title: `mean error ${side} [%]`, hint: "over objects that both have an answer for, of the diameter",
            value: (/** @type {FrameChange} */ f) => f.errors[i],
            of: (/** @type {FrameChange} */ f) => number(f.errors[i], 1) },
          { title: `right ${side}`, value: (/** @type {FrameChange} */ f) => f.right[i],
            of: (/** @type {FrameChange} */ f) => `${f.right[i]} of ${f.n}` }]),
      ])} />`}<//>`;
}

/**
 * The objects of a sequence from frame to frame.
 * @param {{ tracks: ReportTrack[] }} props
 */
function Tracks({ tracks }) {
  const drawn = tracks.filter((t) => t.moved.length);
  const points = drawn.flatMap((t) => t.moved);
  const frames = points.map((p) => p[0]);
  const x = axis("frame", Math.min(...frames), Math.max(...frames));
  const y = axis("moved since the frame before [mm]", 0, Math.max(...points.map((p) => p[1]), 1));
  const steady = "median of the frames that neither flip nor jump";
  /** @type {(title: string, id: Counted) => Column<ReportTrack>} */
  const bad = (title, id) => ({ title, value: (t) => t[id],
    of: (t) => html`<span class=${t[id] ? "bad" : ""}>${t[id]}</span>` });
  /** @type {(title: string, id: Counted, hint?: string) => Column<ReportTrack>} */
  const measured = (title, id, hint) => ({ title, hint, value: (t) => t[id], of: (t) => number(t[id], 1) });
  /** @param {ReportTrack} t */
  const marks = (t) => t.moved.filter((p) => p[3] !== "moved").map(([frame, mm, deg, kind]) => html`
    <${Dot} at=${[x.at(frame), y.at(mm)]} color="var(--bad)">${`${t.name} in frame ${frame}: ${kind}, ${deg}°`}<//>`);
  /** @type {(t: ReportTrack, i: number) => unknown} */
  const line = (t, i) => html`<path class="curve" stroke=${colorOf(i)}
    d=${pathOf(t.moved.map((p) => p[0]), t.moved.map((p) => p[1]), x, y)} />${marks(t)}`;
  const hint = "flip: turned by more than 30° to a pose that nearly looks the same; jump: otherwise, or moved by more "
    + "than 50 mm";
  return html`<${Block} wide title="From frame to frame" hint=${hint}>
    <${Sorted} name="motion" rows=${tracks} columns=${columnsOf(tracks, [
      { title: "object", left: true, value: (t) => t.name },
      ...(new Set(tracks.map((t) => t.run)).size > 1
        ? [{ title: "run", left: true, value: (/** @type {ReportTrack} */ t) => t.run }] : []),
      { title: "scene", value: (t) => t.scene }, { title: "frames", value: (t) => t.frames },
      bad("flips", "flips"), measured("per 100 frames", "per_100"), bad("jumps", "jumps"), bad("no pose", "no_pose"),
      measured("mm a frame", "mm", steady), measured("° a frame", "deg", steady),
      measured("drift [mm]", "drift_mm", "from the first pose to the last, in the world"),
    ])} />
    ${points.length > 1 && html`<${Drawing} x=${x} y=${y}>${drawn.map(line)}<//>
      <${Key} of=${drawn.map((t, i) => [t.name, colorOf(i)])} />`}<//>`;
}

/** @param {{ section: ReportSection }} props */
function Made({ section: { groups, differing } }) {
  const values = groups.map((g, i) => ({ title: g.name, left: true, of: ([, all]) => all[i] }));
  return html`<div class="made">
    ${differing.length > 0 && html`<details><summary>What differs among the settings</summary><div class="scroll">
      <${Table} rows=${differing} columns=${[{ title: "setting", left: true, of: ([name]) => name }, ...values]} />
      </div></details>`}
    ${groups.map((g) => html`<details>
      <summary>Session of ${g.name} <span class="dim">${g.made.join(" · ")}</span></summary>
      <pre>${g.session}</pre></details>`)}
  </div>`;
}
