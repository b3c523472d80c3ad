// Remedies of causes, tried on the answers of a batch: what each mends and breaks, and the answers before and after.
import { html } from "htm/preact";
import { send, state, update, useStore } from "./store.js";
import { openAnswer } from "./answers.js";
import { Button, columnsOf, number, Table } from "./ui.js";

/** @import { FixedAnswer, FixLine, FixShown } from "./messages.d.ts" */

const signed = (/** @type {number} */ x, digits = 1) => `${x > 0 ? "+" : ""}${number(x, digits)}`;
const partsOf = (/** @type {string} */ remedy) => remedy.split(" + ");
/** @type {(remedy: string, chosen: string[]) => boolean} */
const isChosen = (remedy, chosen) => {
  const parts = partsOf(remedy);
  return parts.every((one) => chosen.includes(one)) && (parts.length === 1 || parts.length === chosen.length);
};
const verbs = (/** @type {FixLine} */ row) => (row.fit ? ["fit better", "fit worse"] : ["came right", "broke"]);

/** @param {Partial<import("./store.js").State["remedies"]>} patch */
const choose = (patch) => update({ remedies: { ...state.remedies, ...patch } });

// In the gallery's bar: shows the table, or begins to try where there is none.
export function RemediesButton() {
  const [fix, shown] = useStore((s) => [s.fix, s.remedies.shown]);
  if (!fix) return null;
  const show = () => {
    choose({ shown: !shown });
    if (!fix.table && !fix.running && !shown) send({ verb: "fix" });
  };
  return html`<${Button} engine on=${shown} title="Try what each cause names as its remedy on its answers, and on as many that are right"
    onClick=${show}>Try remedies${fix.running && html` <span class="dim">${fix.done} of ${fix.total}</span>`}<//>`;
}

export function Remedies() {
  const [fix, remedies, answers] = useStore((s) => [s.fix, s.remedies, s.answers]);
  if (!fix || !remedies.shown) return null;
  return html`<section class="remedies scroll">
    <header>${fix.running ? html`<progress max=${Math.max(fix.total, 1)} value=${fix.done} /><span>${fix.done} of ${fix.total} frames</span>
        <${Button} title="What is solved stays; trying again goes on from there" onClick=${() => send({ verb: "fix", stop: true })}>Stop<//>`
      : html`<${Button} engine title="Try again, or go on where it was stopped" onClick=${() => send({ verb: "fix" })}>${fix.table ? "Again" : "Go on"}<//>`}
      ${fix.fault && html`<span class="doubt">${fix.fault}</span>`}<span class="spring" />
      ${fix.table && html`<${Write} shown=${fix.table} several=${answers.runs.length > 1} />`}</header>
    ${fix.table && html`<${RemedyTable} shown=${fix.table} chooses />`}
  </section>`;
}

/**
 * The session with the remedies that are chosen; several are tried together before.
 * @param {{ shown: FixShown, several: boolean }} props
 */
function Write({ shown, several }) {
  const { chosen, file } = useStore((s) => s.remedies);
  const name = chosen.join(" + ");
  const tried = shown.rows.find(({ remedy }) => partsOf(remedy).length === chosen.length && isChosen(remedy, chosen));
  if (!chosen.length) return html`<span class="dim">Choose remedies to write their session</span>`;
  if (!tried) return html`<${Button} engine kind="primary" title=${`Try ${name}`} onClick=${() => send({ verb: "fix", take: chosen })}>Try together<//>`;
  return html`<input value=${file} spellcheck=${false} title=${several ? "One file for each run: its name is added" : "File"}
      onInput=${(e) => choose({ file: e.currentTarget.value })} />
    <${Button} engine kind="primary" title=${`The session with ${name}`} disabled=${!file.trim()}
      onClick=${() => send({ verb: "fix", take: partsOf(tried.remedy), write: file.trim() })}>Write session<//>`;
}

/**
 * A row for each remedy and cause; a click lists its answers.
 * @param {{ shown: FixShown, chooses?: boolean }} props
 */
export function RemedyTable({ shown, chooses }) {
  const { row: at, chosen } = useStore((s) => s.remedies);
  const row = at == null ? undefined : shown.rows[at];
  // The row of several stands for all of them, and for no other.
  const toggle = (/** @type {string} */ remedy) => {
    const parts = partsOf(remedy);
    const others = chosen.filter((one) => !parts.includes(one));
    choose({ chosen: isChosen(remedy, chosen) ? others : parts.length > 1 ? parts : [...others, remedy] });
  };
  const columns = columnsOf(shown.rows, [
    { title: "remedy", left: true, of: (r) => (chooses ? html`<label class="toggle" title="Write this one"
      onClick=${(e) => e.stopPropagation()}><input type="checkbox" checked=${isChosen(r.remedy, chosen)}
      onChange=${() => toggle(r.remedy)} />${r.remedy}</label>` : r.remedy) },
    { title: "cause", left: true, of: (r) => r.cause },
    { title: "mended", hint: "came right; without ground truth, fit better", of: (r) => html`<b class=${r.came_right ? "good" : ""}>${r.came_right}</b> of ${r.tried} ${
      verbs(r)[0]}${r.worse ? html`, <b class="bad">${r.worse}</b> worse` : ""}` },
    { title: "broken", hint: "of answers that were right", of: (r) => html`<b class=${r.broke ? "bad" : ""}>${r.broke}</b> of ${r.right_tried}` },
    { title: "net gain", hint: "answers of these runs, with its 95 % interval", of: (r) => html`<b>${signed(r.net[0])}</b> <small>${signed(r.net[1])} to ${signed(r.net[2])}</small>` },
    { title: "s a frame", hint: "time added", of: (r) => (r.seconds == null ? "–" : signed(r.seconds)) },
  ]);
  return html`<${Table} rows=${shown.rows} columns=${columns} current=${(_, i) => i === at}
      onRow=${(_, i) => choose({ row: i === at ? null : i })} />
    ${row && html`<${Changed} shown=${shown} row=${row} />`}`;
}

/** @param {{ shown: FixShown, row: FixLine }} props */
function Changed({ shown, row }) {
  const answers = row.answers.map((k) => shown.answers[k]).sort((a, b) => Number(b.was_bad) - Number(a.was_bad) || Math.abs(b.change) - Math.abs(a.change));
  const [gained, lost] = verbs(row);
  /** @param {FixedAnswer} one */
  const words = (one) => (one.change > 0 ? gained : one.change < 0 ? lost : one.was_bad ? "as before" : row.fit ? "as before" : "still right");
  const pair = (/** @type {readonly (number | null)[]} */ [a, b], digits) => `${number(a, digits)} → ${number(b, digits)}`;
  return html`<h3 key=${`${row.remedy} ${row.cause}`} ref=${(/** @type {HTMLElement | null} */ e) => e?.scrollIntoView({ block: "start" })}>
    ${row.remedy}, ${row.cause} <span class="dim">${answers.length} answers</span></h3><${Table} rows=${answers} onRow=${(/** @type {FixedAnswer} */ one) => openBoth(one)} columns=${columnsOf(answers, [
      { title: "object", left: true, of: (one) => one.name },
      { title: "frame", left: true, of: (one) => one.frame },
      { title: "was", left: true, of: (one) => (one.was_bad ? (row.fit ? "in doubt" : "wrong") : row.fit ? "not in doubt" : "right") },
      { title: "now", left: true, of: (one) => html`<span class=${one.change > 0 ? "good" : one.change < 0 ? "bad" : "dim"}>${words(one)}</span>` },
      ...(row.fit ? [] : [{ title: "ADD(-S) [mm]", of: (/** @type {FixedAnswer} */ one) => pair(one.errors, 1) }]),
      { title: "score", of: (one) => pair(one.scores, 3) },
    ])} />`;
}

/**
 * Opens an answer, and beside it as B the run with the remedy.
 * @param {FixedAnswer} one
 */
function openBoth(one) {
  const row = one.key == null ? undefined : state.answers?.rows[one.key];
  if (row) openAnswer(row, one.recording);
}
