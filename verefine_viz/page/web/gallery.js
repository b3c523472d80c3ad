// The answers of a batch as cards, with filters and tags. Sorts and filters without the server.
import { html } from "htm/preact";
import { useState, useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { addressOf, send, state, update, useStore } from "./store.js";
import { besideError, choose, chosenOf, errorWords, failures, neighbour, openAnswer, openRow, passes, TONES, valuesOf,
  visible } from "./answers.js";
import { Button, Icon, IconButton, Select, number } from "./ui.js";
import { addKeys } from "./keys.js";
import { toast } from "./toasts.js";
import { Remedies, RemediesButton } from "./remedies.js";
import { Plot } from "./gallery_plot.js";
import { FrameCards, hasStrip } from "./frame_strip.js";
import { hasSequence, Sequence, Switch } from "./sequence.js";

/** @import { GalleryRow } from "./messages.d.ts" */

/** @type {["tag" | keyof GalleryRow, string][]} */
const FACETS = [["result", "Result"], ["cause", "Cause"], ["object", "Object"], ["tag", "Tag"], ["run", "Run"], ["method", "Method"],
  ["group", "Group"], ["compared", "Compared"]]; // the last two of a report
const MOST_LINES = 12; // of a facet before it is unfolded

export function Failures() {
  const [answers, row, before, after] = useStore((s) => [s.answers, openRow(s), neighbour(s, -1), neighbour(s, 1)]);
  if (!answers || !failures(state).length) return null;
  const at = failures(state).indexOf(row);
  /** @param {GalleryRow | null} one */
  const words = (one) => (one ? `${one.name}, frame ${one.frame}, ${errorWords(one)}` : "none");
  return html`<div class="group failures">
    <${IconButton} icon="back" disabled=${!before} title=${`Failure before: ${words(before)}`} onClick=${() => openAnswer(before)} />
    <span class="dim" title="Failures of the batch, in the gallery's order">${at < 0 ? "–" : at + 1} / ${failures(state).length}</span>
    <${IconButton} icon="step" disabled=${!after} title=${`Next failure: ${words(after)}`} onClick=${() => openAnswer(after)} />
  </div>`;
}

/** @param {GalleryRow} row */
const tipOf = (row) => [
  `${row.name || "all objects"} · frame ${row.frame} · ${row.run}`,
  row.err == null && row.undetermined_mm != null ? "No ground truth. ±: by so much it may be off without the score telling." : "",
  row.tone === "seen" ? `${number(row.err_seen, 1)} mm from the nearest pose that the image allows.` : "",
  row.cause, row.evidence || row.message, !row.opens ? "Cannot be opened."
    : row.command && row.part == null && !row.file ? row.command : row.k ? `Opens at iteration ${row.k}.` : "Opens before iteration 1.",
].filter(Boolean).join("\n");

export function Gallery() {
  const answers = useStore((s) => s.answers);
  const [isFrames, isSequence] = useStore((s) => [hasStrip(s), s.sequence.on && hasSequence(s)]);
  if (!answers && isFrames) return html`<${FrameCards} />`;
  if (!answers) return html`<${NoBatch} />`;
  if (isSequence) return html`<${SequenceBar} /><${Sequence} />`;
  return html`<${Bar} /><${Remedies} /><div class="gallery-body"><${Cards} /><${Facets} /></div>`;
}

// What stands there before a batch is open: where to open one, and how to run one of what is open.
function NoBatch() {
  const frame = useStore((s) => s.frame);
  const [folder, setFolder] = useState("");
  const open = (e) => {
    e.preventDefault();
    if (folder.trim()) send({ verb: "open", batch: folder.trim() });
  };
  const command = `verefine-viz batch ${shellWord(frame?.session_file ?? "SESSION.toml")} --out runs`;
  const copy = () => navigator.clipboard.writeText(command).then(() => toast("note", "Copied."), () => toast("note", command));
  return html`<form class="no-batch" onSubmit=${open}>
    <h2>No batch is open</h2>
    <label>Open one<span class="row"><input placeholder="its folder" spellcheck=${false} value=${folder}
      onInput=${(e) => setFolder(e.currentTarget.value)} /><button type="submit" class="button primary"
      title="Show its answers here" disabled=${!folder.trim()}>Open</button></span></label>
    <div>Run all frames of this session<span class="row"><kbd>${command}</kbd><${Button} title="Copy the command" onClick=${copy}>Copy<//></span></div>
  </form>`;
}
const shellWord = (text) => (/^[\w./~-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);

const SequenceBar = () => html`<header class="gallery-bar"><${Switch} /><h2 title=${state.answers.outcome}>${state.answers.outcome}</h2></header>`;

function Bar() {
  const [answers, gallery] = useStore((s) => [s.answers, s.gallery]);
  const rows = visible(state);
  const { selected, only, search } = gallery;
  const notes = [answers.doubt, ...answers.notes, ...answers.faults, answers.unfinished ? `Runs without a finished frame: ${answers.unfinished}` : ""].filter(Boolean);
  const isFiltered = search || Object.values(only).some((values) => values.length);
  return html`<header class="gallery-bar"><${Switch} />
    <h2 title=${answers.outcome}>${answers.outcome}</h2>
    ${notes.length > 0 && html`<span class="doubt" title=${notes.join("\n")}><${Icon} name="warn" />${notes.length === 1 ? notes[0] : `${notes.length} notes`}</span>`}
    <span class="spring" />
    <${RemediesButton} />
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
  const input = useRef(null);
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
  const host = useRef(null);
  const [box, setBox] = useState({ width: 0, height: 0, rem: 16 });
  const [top, setTop] = useState(0);
  useLayoutEffect(() => {
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
  // A window of lines above and below is there as well, so that their pictures come before they are in sight.
  const ahead = Math.max(1, Math.ceil(box.height / (height + gap)));
  const first = Math.max(0, Math.floor(top / (height + gap)) - ahead);
  const last = Math.min(lines, Math.ceil((top + box.height) / (height + gap)) + ahead);

  /** @param {number} line */
  const isSeen = (line) => (line + 1) * (height + gap) > top && line * (height + gap) < top + box.height;

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
  const live = useRef(null);
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
      inGallery(["/"], "Search", () => /** @type {HTMLElement | null} */ (document.querySelector(".gallery .search input"))?.focus()),
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
          order=${gallery.order} isSeen=${isSeen(Math.floor(n / columns))} current=${row.key === gallery.at} open=${row.key === open && frame} />`;
      })}
    </div>
    <${CardFilm} />
    ${rows.length === 0 && html`<p class="empty">No answer passes the filters. <button class="link" title="without filters" onClick=${() => choose({ only: {}, search: "" })}>Show all</button></p>`}
  </div>`;
}

// The answer stands in the address of its picture: another one that gets its number has another picture.
/** @type {(what: "thumb" | "film", row: GalleryRow) => string} */
const pictureOf = (what, row) =>
  addressOf(`/${what}/${row.key}?${encodeURIComponent(`${row.run} ${row.frame} ${row.obj} ${row.score ?? ""}`)}`);

// Not in the card, which is moved: there it could not lie over all.
function CardFilm() {
  const row = useStore((s) => s.answers?.rows[s.filmOf] ?? null);
  return row && html`<img class="card-film" key=${row.key} src=${pictureOf("film", row)} alt="" onError=${() => showFilm(null)} />`;
}

// The film of the card under the mouse, once that rests on it.
const REST_MS = 500;
let resting = null;
function showFilm(/** @type {number | null} */ key) {
  clearTimeout(resting);
  if (key != null) resting = setTimeout(() => update({ filmOf: key }), REST_MS);
  else if (state.filmOf != null) update({ filmOf: null });
}

function toggle(key) {
  const selected = new Set(state.gallery.selected);
  if (!selected.delete(key)) selected.add(key);
  choose({ selected, at: key });
}

/** @param {{ row: GalleryRow, place: object, several: boolean, selected: boolean, current: boolean, open: boolean, order: string, isSeen: boolean }} props */
function Card({ row, place, several, selected, current, open, order, isSeen }) {
  const [icon, words] = TONES[row.tone];
  const click = (e) => {
    if (e.target.closest("button, input")) return;
    showFilm(null); // What a click opens takes the card from under the mouse, which then never leaves it.
    if (e.ctrlKey || e.metaKey || e.shiftKey) toggle(row.key);
    else openAnswer(row);
  };
  return html`<article onMouseEnter=${() => row.film && showFilm(row.key)} onMouseLeave=${() => showFilm(null)} class=${`card ${row.tone} ${selected ? "selected" : ""} ${current ? "current" : ""} ${row.opens ? "opens" : ""}`} style=${place} title=${tipOf(row)} onClick=${click}>
    <div class="thumb">${row.thumb ? html`<img src=${pictureOf("thumb", row)} alt="" fetchpriority=${isSeen ? "high" : "low"} draggable=${false} />` : html`<span>${errorWords(row)}</span>`}
      <i class="tone-mark" title=${words}><${Icon} name=${icon} /></i>
      ${open && html`<b class="open-mark">open</b>`}
      <input type="checkbox" checked=${selected} title="Select (X, or Ctrl and click)" onChange=${() => toggle(row.key)} /></div>
    <div class="line"><b>${row.name || "all objects"}</b><span class="dim">${row.frame}</span></div>
    <div class="line"><span class="error">${errorWords(row)}</span><span>${besideError(row, order)}</span></div>
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
