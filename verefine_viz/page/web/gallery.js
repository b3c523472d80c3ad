// The answers of a batch: cards with filters, a plot of their scores, and tags. Sorts and filters without the server.
import { html, useState, useEffect, useMemo, useRef } from "./vendor/htm-preact.js";
import { state, useStore, update, listen, send, addressOf } from "./store.js";
import { momentOf } from "./moment.js";
import { Button, Icon, IconButton, Select, number } from "./ui.js";
import { addKeys } from "./keys.js";
import { setPreset } from "./layout.js";

export const TONES = {
  wrong: ["cross", "wrong", "--bad"], none: ["cross", "no answer", "--doubt"], right: ["check", "right", "--good"],
  doubt: ["warn", "impossible, no ground truth", "--doubt"], unknown: ["question", "no ground truth", "--dim"], waiting: ["dot", "not solved yet", "--faint"],
};
const FACETS = [["result", "Result"], ["object", "Object"], ["cause", "Cause"], ["tag", "Tag"], ["run", "Run"], ["method", "Method"],
  ["group", "Group"], ["compared", "Compared"]]; // the last two of a report
const MOST_LINES = 12; // of a facet before it is unfolded
const valuesOf = (row, by) => (by === "tag" ? row.tags : by === "object" ? [row.name || "all objects"] : row[by] ? [row[by]] : []);

// What is chosen; `only`: filter → values, any of which passes. `at`: the card that keys move from.
Object.assign(state, { gallery: { order: "error", only: {}, search: "", selected: new Set(), at: null, tagging: false } });
export const choose = (patch) => update({ gallery: { ...state.gallery, ...patch } });

// Rows by what is chosen; without one filter for the counts of its own values.
function passes(row, { only, words }, except) {
  for (const by in only) {
    if (by !== except && only[by].length && !valuesOf(row, by).some((v) => only[by].includes(v))) return false;
  }
  return words.every((word) => row.words.includes(word) || row.tags.some((tag) => tag.toLowerCase().includes(word)));
}
const chosenOf = ({ only, search }) => ({ only, words: search.toLowerCase().split(/\s+/).filter(Boolean) });

let shown = { rows: [] };
// The rows that pass, in order.
export function visible(s) {
  const { answers, gallery } = s;
  if (!answers) return [];
  if (shown.answers === answers && shown.only === gallery.only && shown.search === gallery.search && shown.order === gallery.order) return shown.rows;
  const chosen = chosenOf(gallery);
  const keys = (answers.orders.find((o) => o.id === gallery.order) ?? answers.orders[0]).keys;
  const rows = keys.map((key) => answers.rows[key]).filter((row) => passes(row, chosen));
  shown = { answers, only: gallery.only, search: gallery.search, order: gallery.order, rows };
  return rows;
}

let opened = { rows: [] };
// The answer that is open, or null.
export function openRow(s) {
  const { frame, answers } = s;
  if (!frame?.run || !answers) return null;
  if (opened.answers !== answers || opened.frame !== frame) {
    const rows = answers.rows.filter((row) => row.run === frame.run && row.frame === frame.frame && row.method === frame.method);
    opened = { answers, frame, rows };
  }
  const obj = momentOf(s)?.obj;
  return opened.rows.find((row) => row.obj === obj) ?? opened.rows[0] ?? null;
}

const isFailure = (row) => row.opens && ["wrong", "none", "doubt"].includes(row.tone);
let failed = { rows: [] };
function failures(s) {
  const { answers } = s;
  const of = visible(s);
  if (failed.of !== of) {
    const rows = of.filter(isFailure);
    failed = { of, rows: rows.length || !answers ? rows : answers.orders[0].keys.map((key) => answers.rows[key]).filter(isFailure) };
  }
  return failed.rows;
}
// The failure after (1) or before (−1) the answer that is open, in the gallery's order; null at the ends.
export function neighbour(s, by) {
  const rows = failures(s);
  const open = openRow(s);
  const at = rows.findIndex((row) => row.key === open?.key);
  return rows[at < 0 ? (by > 0 ? 0 : rows.length - 1) : at + by] ?? null;
}

let leaving = null; // the frame that was open when an answer was asked for
export function openAnswer(row) {
  if (!row?.opens || !send({ verb: "open", answer: row.key })) return;
  leaving = { frame: state.frame?.id };
  choose({ at: row.key });
}

export function Failures() {
  const [answers, row, before, after] = useStore((s) => [s.answers, openRow(s), neighbour(s, -1), neighbour(s, 1)]);
  if (!answers || !failures(state).length) return null;
  const at = failures(state).indexOf(row);
  const words = (one) => (one ? `${one.name}, frame ${one.frame}, ${errorWords(one)}` : "none");
  return html`<div class="group failures">
    <${IconButton} icon="back" disabled=${!before} title=${`Failure before: ${words(before)}`} onClick=${() => openAnswer(before)} />
    <span class="dim" title="Failures of the batch, in the gallery's order">${at < 0 ? "–" : at + 1} / ${failures(state).length}</span>
    <${IconButton} icon="step" disabled=${!after} title=${`Next failure: ${words(after)}`} onClick=${() => openAnswer(after)} />
  </div>`;
}

let known = null;
const hadLink = location.hash.length > 1;
listen(() => {
  const { answers } = state;
  if (answers && answers !== known) {
    for (const row of answers.rows) {
      row.words ??= [row.name, row.frame, row.method, row.run, row.result, row.cause, row.evidence, row.message].join(" ").toLowerCase();
    }
    if (!known) {
      choose({ only: Object.fromEntries(Object.entries(answers.first).map(([by, value]) => [by, [value]])) });
      if (!hadLink && !state.report) setPreset("gallery");
    }
    known = answers;
  }
  if (leaving && state.frame?.id !== leaving.frame) {
    leaving = null;
    if (["gallery", "report"].includes(state.view.preset)) setPreset("inspect");
  }
});

const errorWords = (row) =>
  row.tone === "waiting" ? "not solved yet"
  : row.status === "failed" ? "frame failed" : row.status === "left_out" ? "left out" : row.status !== "ok" ? "no answer"
  : row.err != null ? `${number(row.err, 1)} of ${number(row.limit, 1)} mm`
  : row.undetermined_mm != null ? `± ${number(row.undetermined_mm, 1)} mm, ${number(row.undetermined_deg, 0)}°` : "no ground truth";
const tipOf = (row) => [
  `${row.name || "all objects"} · frame ${row.frame} · ${row.run}`,
  row.err == null && row.undetermined_mm != null ? "No ground truth. ±: by so much it may be off without the score telling." : "",
  row.cause, row.evidence || row.message, !row.opens ? "Cannot be opened."
    : row.command && row.part == null && !row.file ? row.command : row.k ? `Opens at iteration ${row.k}.` : "Opens before iteration 1.",
].filter(Boolean).join("\n");

export function Gallery() {
  const answers = useStore((s) => s.answers);
  if (!answers) return html`<p class="empty">No batch is open. <kbd>verefine-viz batch SESSION --out FOLDER</kbd> solves all frames, <kbd>verefine-viz view FOLDER</kbd> shows them here.</p>`;
  return html`<${Bar} /><div class="gallery-body"><${Cards} /><${Facets} /></div>`;
}

function Bar() {
  const [answers, gallery] = useStore((s) => [s.answers, s.gallery]);
  const rows = visible(state);
  const { selected, only, search } = gallery;
  const notes = [answers.doubt, ...answers.notes, ...answers.faults, answers.unfinished ? `Runs without a finished frame: ${answers.unfinished}` : ""].filter(Boolean);
  const isFiltered = search || Object.values(only).some((values) => values.length);
  return html`<header class="gallery-bar">
    <h2 title=${answers.outcome}>${answers.outcome}</h2>
    ${notes.length > 0 && html`<span class="doubt" title=${notes.join("\n")}><${Icon} name="warn" />${notes.length === 1 ? notes[0] : `${notes.length} notes`}</span>`}
    <span class="spring" />
    ${selected.size > 0 && html`<span class="group"><b>${selected.size} selected</b><${Button} title="Clear the selection (Esc)" onClick=${() => choose({ selected: new Set() })}>Clear<//></span>`}
    ${gallery.tagging ? html`<${TagField} />` : html`<${Button} disabled=${!targets().length} title="Tag the selected cards, or the current one (T)" onClick=${() => choose({ tagging: true })}>Tag<//>`}
    <label class="search"><${Icon} name="search" /><input placeholder="search" spellcheck=${false} value=${search} title="Words in name, frame, method, cause, evidence or tags (/)"
      onInput=${(e) => choose({ search: e.currentTarget.value, at: null })}
      onKeyDown=${(e) => e.key === "Enter" && e.currentTarget.blur()} /></label>
    <${Select} label="Order" value=${gallery.order} options=${answers.orders.map((o) => [o.id, o.words])} onChange=${(order) => choose({ order })} />
    <span class="count">${rows.length} of ${answers.rows.length} shown</span>
    <${Button} disabled=${!isFiltered} title="Show all answers" onClick=${() => choose({ only: {}, search: "" })}>All<//>
  </header>`;
}

// What a tag is given to: the selected cards, or the current one.
const targets = () => (state.gallery.selected.size ? [...state.gallery.selected] : state.gallery.at != null ? [state.gallery.at] : []);

function TagField() {
  const input = useRef();
  useEffect(() => input.current.focus(), []);
  const done = () => choose({ tagging: false });
  const tags = [...new Set(state.answers.rows.flatMap((row) => row.tags))].sort();
  const down = (e) => {
    const tag = e.currentTarget.value.trim();
    if (e.key === "Enter" && tag) {
      const all = targets();
      const on = !all.every((key) => state.answers.rows[key].tags.includes(tag)); // given to all that have it, it is taken away
      send({ verb: "tag", answers: all, tag, on });
    }
    if (e.key === "Enter" || e.key === "Escape") {
      e.stopPropagation();
      done();
    }
  };
  return html`<input class="tag-field" ref=${input} list="gallery-tags" maxlength="40" placeholder=${`tag of ${targets().length}, Enter`} onKeyDown=${down} onBlur=${done} />
    <datalist id="gallery-tags">${tags.map((tag) => html`<option value=${tag} />`)}</datalist>`;
}

// Cards: only those in sight are in the page.

function Cards() {
  const [answers, gallery, open, frame] = useStore((s) => [s.answers, s.gallery, openRow(s)?.key, s.frame]);
  const rows = visible(state);
  const host = useRef();
  const [box, setBox] = useState({ width: 0, height: 0, rem: 16 });
  const [top, setTop] = useState(0);
  useEffect(() => {
    const measure = () => {
      const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
      setBox({ width: host.current.clientWidth, height: host.current.clientHeight, rem });
    };
    const observer = new ResizeObserver(measure);
    observer.observe(host.current);
    measure();
    return () => observer.disconnect();
  }, []);
  const gap = 0.6 * box.rem;
  const columns = Math.max(1, Math.floor((box.width - gap) / (12.5 * box.rem + gap)));
  const width = (box.width - gap * (columns + 1)) / columns;
  const height = 0.75 * width + 7.4 * box.rem;
  const lines = Math.ceil(rows.length / columns);
  const first = Math.max(0, Math.floor(top / (height + gap)) - 1);
  const last = Math.min(lines, Math.ceil((top + box.height) / (height + gap)) + 1);

  const at = rows.findIndex((row) => row.key === gallery.at);
  const move = (by) => {
    if (!rows.length) return;
    const next = Math.max(0, Math.min(rows.length - 1, at < 0 ? 0 : at + by));
    choose({ at: rows[next].key });
    const y = Math.floor(next / columns) * (height + gap);
    const { scrollTop, clientHeight } = host.current;
    if (y < scrollTop) host.current.scrollTop = y;
    else if (y + height + 2 * gap > scrollTop + clientHeight) host.current.scrollTop = y + height + 2 * gap - clientHeight;
  };
  const live = useRef();
  live.current = { move, columns, current: rows[at] };
  useEffect(() => {
    const when = () => state.view.preset === "gallery" || (state.view.preset === "report" && host.current.matches(":hover"));
    const inGallery = (keys, title, action, more) => ({ id: `gallery-${keys[0]}`, keys, title, group: "Gallery", action, when, ...more });
    return addKeys([
      inGallery(["ArrowLeft"], "Card before", () => live.current.move(-1)),
      inGallery(["ArrowRight"], "Next card", () => live.current.move(1)),
      inGallery(["ArrowUp"], "Card above", () => live.current.move(-live.current.columns)),
      inGallery(["ArrowDown"], "Card below", () => live.current.move(live.current.columns)),
      inGallery(["Enter"], "Open the card", () => openAnswer(live.current.current)),
      inGallery(["x"], "Select the card", () => state.gallery.at != null && toggle(state.gallery.at)),
      inGallery(["t"], "Tag", () => targets().length && choose({ tagging: true })),
      inGallery(["/"], "Search", () => document.querySelector(".gallery .search input")?.focus()),
      inGallery(["Escape"], "Clear the selection", () => choose({ selected: new Set() }), { when: () => when() && state.gallery.selected.size > 0 && !state.overlay }),
    ]);
  }, []);
  useEffect(() => {
    host.current.scrollTop = 0;
  }, [gallery.only, gallery.order, gallery.search]);

  return html`<div class="cards scroll" ref=${host} onScroll=${(e) => setTop(e.currentTarget.scrollTop)}>
    <div class="cards-all" style=${{ height: `${lines * (height + gap) + gap}px` }}>
      ${box.width > 0 && rows.slice(first * columns, last * columns).map((row, i) => {
        const n = first * columns + i;
        const place = { width: `${width}px`, height: `${height}px`, transform: `translate(${gap + (n % columns) * (width + gap)}px, ${gap + Math.floor(n / columns) * (height + gap)}px)` };
        return html`<${Card} key=${row.key} row=${row} place=${place} several=${answers.runs.length > 1} selected=${gallery.selected.has(row.key)}
          current=${row.key === gallery.at} open=${row.key === open && frame} />`;
      })}
    </div>
    ${rows.length === 0 && html`<p class="empty">No answer passes the filters. <button class="link" title="without filters" onClick=${() => choose({ only: {}, search: "" })}>Show all</button></p>`}
  </div>`;
}

function toggle(key) {
  const selected = new Set(state.gallery.selected);
  if (!selected.delete(key)) selected.add(key);
  choose({ selected, at: key });
}

function Card({ row, place, several, selected, current, open }) {
  const [icon, words] = TONES[row.tone];
  const click = (e) => {
    if (e.target.closest("button, input")) return;
    if (e.ctrlKey || e.metaKey || e.shiftKey) toggle(row.key);
    else openAnswer(row);
  };
  // The answer stands in the address of its picture: another one that gets its number has another picture.
  const picture = addressOf(`/thumb/${row.key}?${encodeURIComponent(`${row.run} ${row.frame} ${row.obj} ${row.score ?? ""}`)}`);
  return html`<article class=${`card ${row.tone} ${selected ? "selected" : ""} ${current ? "current" : ""} ${row.opens ? "opens" : ""}`} style=${place} title=${tipOf(row)} onClick=${click}>
    <div class="thumb">${row.thumb ? html`<img src=${picture} alt="" loading="lazy" draggable=${false} />` : html`<span>${errorWords(row)}</span>`}
      <i class="tone-mark" title=${words}><${Icon} name=${icon} /></i>
      ${open && html`<b class="open-mark">open</b>`}
      <input type="checkbox" checked=${selected} title="Select (X, or Ctrl and click)" onChange=${() => toggle(row.key)} /></div>
    <div class="line"><b>${row.name || "all objects"}</b><span class="dim">${row.frame}</span></div>
    <div class="line"><span class="error">${errorWords(row)}</span><span>${row.score != null && number(row.score, 2)}</span></div>
    <div class="line cause dim"><span>${row.cause || (row.status !== "ok" ? row.message : "")}</span></div>
    <div class="line dim"><span>${several ? row.run : row.method}</span><span class="tags">${row.tags.map((tag) => html`
      <button key=${tag} title=${`Take the tag ${tag} away`} onClick=${() => send({ verb: "tag", answers: [row.key], tag, on: false })}>${tag}</button>`)}</span></div>
  </article>`;
}

// Beside the cards: the plot, and every filter with how often each of its values is right, wrong or missing.

function Facets() {
  const [answers, gallery] = useStore((s) => [s.answers, s.gallery]);
  const [unfolded, setUnfolded] = useState({});
  const chosen = chosenOf(gallery);
  return html`<aside class="facets scroll"><${Plot} />
    ${FACETS.map(([by, title]) => {
      const counts = new Map();
      const there = new Set();
      for (const row of answers.rows) {
        const ok = passes(row, chosen, by);
        for (const value of valuesOf(row, by)) {
          there.add(value);
          if (!ok) continue;
          if (!counts.has(value)) counts.set(value, { all: 0 });
          const count = counts.get(value);
          count.all += 1;
          count[row.tone] = (count[row.tone] ?? 0) + 1;
        }
      }
      if (there.size < 2 && by !== "cause" && by !== "tag") return null;
      if (!there.size) return null;
      const on = gallery.only[by] ?? [];
      const values = [...there].sort((a, b) => (counts.get(b)?.all ?? 0) - (counts.get(a)?.all ?? 0) || (a < b ? -1 : 1));
      const most = Math.max(1, ...[...counts.values()].map((c) => c.all));
      const listed = unfolded[by] ? values : values.filter((v, i) => (i < MOST_LINES && counts.has(v)) || on.includes(v));
      const set = (value) => choose({ only: { ...gallery.only, [by]: on.includes(value) ? on.filter((v) => v !== value) : [...on, value] }, at: null });
      return html`<section key=${by}><h3>${title}${on.length > 0 && html`<button class="link" onClick=${() => choose({ only: { ...gallery.only, [by]: [] } })}>all</button>`}</h3>
        ${listed.map((value) => html`<${Facet} key=${value} value=${value} count=${counts.get(value)} most=${most} on=${on.includes(value)} dim=${on.length > 0 && !on.includes(value)} onClick=${() => set(value)} />`)}
        ${listed.length < values.length && html`<button class="link more" onClick=${() => setUnfolded({ ...unfolded, [by]: true })}>${values.length - listed.length} more</button>`}
      </section>`;
    })}</aside>`;
}

function Facet({ value, count = { all: 0 }, most, on, dim, onClick }) {
  const parts = Object.keys(TONES).filter((tone) => count[tone]);
  const words = `${value}: ${parts.map((tone) => `${count[tone]} ${TONES[tone][1]}`).join(", ") || "none"}`;
  return html`<button type="button" class=${`facet ${on ? "on" : ""} ${dim ? "off" : ""}`} title=${words} aria-pressed=${String(on)}
    onClick=${(e) => { e.currentTarget.blur(); onClick(); }}>
    <span class="value">${value}</span>
    <span class="share" style=${{ width: `${(100 * count.all) / most}%` }}>${parts.map((tone) => html`<i class=${tone} style=${{ flexGrow: count[tone] }} />`)}</span>
    <span class="n">${count.all}</span></button>`;
}

const [LOW, HIGH] = [0.003, 2]; // of the diameter
const MOST_MM = 30; // of what is undetermined
// What scores are drawn over: errors, or where none is known how far the answers are undetermined. `at`: from 0 to 1.
const AXES = [
  { title: "Score over error", words: "error [share of the diameter]", of: (row) => (row.limit && row.err != null ? (0.1 * row.err) / row.limit : null),
    at: (share) => Math.log(Math.max(LOW, Math.min(HIGH, share)) / LOW) / Math.log(HIGH / LOW), limit: 0.1,
    ticks: [[0.01, "1 %"], [0.1, "10 %"], [1, "100 %"]], counted: "with ground truth" },
  { title: "Score over uncertainty", words: "undetermined [mm]", of: (row) => row.undetermined_mm,
    at: (mm) => Math.min(MOST_MM, mm) / MOST_MM, limit: null, ticks: [[0, "0"], [10, "10"], [20, "20"], [MOST_MM, `${MOST_MM}`]], counted: "without ground truth" },
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

function Points({ of, axis }) {
  const [answers, gallery, theme, open] = useStore((s) => [s.answers, s.gallery, s.theme, openRow(s)?.key]);
  const canvas = useRef();
  const [near, setNear] = useState(null);
  const points = useRef([]);
  const rows = visible(state);
  const known = useMemo(() => (of ?? answers.rows).filter(isOn(axis)), [answers, of?.length, axis]);
  useEffect(() => {
    const draw = () => {
      const c = canvas.current;
      const ratio = devicePixelRatio || 1;
      const [w, h] = [c.clientWidth, c.clientHeight];
      [c.width, c.height] = [w * ratio, h * ratio];
      const ctx = c.getContext("2d");
      ctx.scale(ratio, ratio);
      const css = getComputedStyle(c);
      const color = (name) => css.getPropertyValue(name);
      const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
      const [left, right, low, high] = [2.4 * rem, w - 0.6 * rem, h - 2.5 * rem, 0.6 * rem];
      const floor = Math.min(0.9, Math.floor(10 * Math.min(...known.map((row) => row.score), 0.9)) / 10);
      const x = (value) => left + axis.at(value) * (right - left);
      const y = (score) => low - ((Math.max(floor, Math.min(1, score)) - floor) / (1 - floor)) * (low - high);
      ctx.font = `${0.85 * rem}px ${css.fontFamily}`;
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
        ctx.setLineDash(value === axis.limit ? [4, 3] : []);
        ctx.strokeStyle = color(value === axis.limit ? "--dim" : "--line");
        line(x(value), high, x(value), low);
        ctx.fillText(words, x(value), low + 0.25 * rem);
      }
      ctx.setLineDash([]);
      ctx.fillText(axis.words, (left + right) / 2, low + 1.3 * rem);
      const strong = new Set(of ?? rows);
      points.current = known.map((row) => ({ row, x: x(axis.of(row)), y: y(row.score) }));
      const size = (known.length > 1000 ? 0.25 : 0.42) * rem;
      for (const isStrong of [false, true]) {
        ctx.globalAlpha = isStrong ? 0.8 : 0.15;
        for (const tone of ["right", "unknown", "doubt", "wrong"]) {
          ctx.fillStyle = color(TONES[tone][2]);
          ctx.beginPath();
          for (const p of points.current) {
            if (p.row.tone !== tone || strong.has(p.row) !== isStrong) continue;
            if (known.length > 1000) ctx.fillRect(p.x - size / 2, p.y - size / 2, size, size); // circles take 20 times as long
            else {
              ctx.moveTo(p.x + size / 2, p.y);
              ctx.arc(p.x, p.y, size / 2, 0, 7);
            }
          }
          ctx.fill();
        }
      }
    };
    const observer = new ResizeObserver(draw); // draws at once, too
    observer.observe(canvas.current);
    return () => observer.disconnect();
  }, [rows, theme, known]);
  const find = (e) => {
    const box = canvas.current.getBoundingClientRect();
    const [u, v] = [e.clientX - box.left, e.clientY - box.top];
    const passing = new Set(of ?? rows);
    const distance = (p) => Math.hypot(p.x - u, p.y - v) + (passing.has(p.row) ? 0 : 4);
    const best = points.current.reduce((a, b) => (a && distance(a) <= distance(b) ? a : b), null);
    return best && distance(best) <= REACH ? best : null;
  };
  return html`<section class="plot">${!of && html`<h3>${axis.title}</h3>`}
    <div class="rings">${points.current.filter((p) => p.row.key === open || p.row.key === near?.row.key).map((p) => html`
      <i key=${p.row.key} style=${{ transform: `translate(${p.x}px, ${p.y}px)` }} />`)}</div>
    <canvas ref=${canvas} class=${near ? "near" : ""} onPointerMove=${(e) => setNear(find(e))} onPointerLeave=${() => setNear(null)} onClick=${(e) => openAnswer(find(e)?.row)} />
    <p>${near ? html`<b>${near.row.name}</b> ${near.row.frame} · ${errorWords(near.row)} · score ${number(near.row.score, 2)}` : html`<span class="dim">${known.length} ${axis.counted}</span>`}</p>
  </section>`;
}
