// What another program recorded: each step with its own score, whether that agrees with ours, and going on from there.
import { html } from "htm/preact";
import { send, setView, state, useStore } from "../store.js";
import { armColor, momentOf, rowsOf } from "../moment.js";
import { seek } from "../cursor.js";
import { Button, columnsOf, number, Swatch, Table } from "../ui.js";
import { runBeside } from "./beside.js";
import { useLatest } from "./latest.js";
import { settingsOf } from "./setting.js";

/** @import { RecordedPose } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */

export const title = "Trace";
export const hint = "the steps that another program recorded, and its scores beside ours";
export const needs = (/** @type {import("../store.js").State} */ s) => momentOf(s)?.object.recorded > 0;
export const empty = "No steps of another program were recorded for this object.";

const [AGREE, DIFFER] = [0.7, 0.3]; // docs/methods.md 1.12
const METHOD = "rir"; // continues a trace
const verdictOf = (rank) => (rank >= AGREE ? ["good", "they agree"] : rank < DIFFER ? ["bad", "they do not agree"] : ["", "they agree in part"]);

export function render() {
  const moment = useStore(momentOf);
  const { branch, obj, object, run } = moment;
  const answer = useLatest({ what: "recorded", branch, obj, done: run.rows.length }, "recorded", `${branch} ${obj}`);
  if (!answer) return html`<p class="empty">Reading what was recorded.</p>`;
  if ("gone" in answer) return html`<p class="empty">${answer.gone}</p>`;
  const scored = answer.rows.filter((r) => r.theirs != null && r.ours != null);
  const here = answer.rows.find((r) => r.k === moment.row?.k && !moment.isAnswer);
  const go = (/** @type {RecordedPose} */ r) => {
    seek(r.k);
    setView({ obj, arm: r.k ? null : r.arm });
  };
  const [tone, words] = verdictOf(answer.rank);
  return html`<div class="tab trace">
    ${here && html`<p class="summary"><b>${here.name}</b>, hypothesis ${here.arm + 1}${here.theirs == null ? "" : `, its own score ${+here.theirs.toPrecision(4)}`}${here.note && `: ${here.note}`}</p>`}
    <${GoOn} moment=${moment} />
    ${scored.length > 0 && html`<h3>Its score and ours, ${object.label}</h3>
      <p>${answer.rank == null ? html`${scored.length} pose${scored.length === 1 ? "" : "s"}: too few, or too alike, to correlate.`
        : html`Rank correlation <b class=${tone}>${number(answer.rank)}</b> over ${scored.length} poses: ${words}.`}</p>
      <${Scatter} rows=${scored} moment=${moment} go=${go} />`}
    <h3>Recorded steps</h3>
    <${Table} rows=${answer.rows} keyOf=${(r) => `${r.k} ${r.arm}`} onRow=${go} current=${(/** @type {RecordedPose} */ r) => r === here} columns=${columnsOf(answer.rows, [
      { title: "step", left: true, of: (r) => html`<${Swatch} color=${armColor(moment, r.arm)} />${r.arm + 1} <span>${r.name}</span>${r.note && html` <span class="dim">${r.note}</span>`}` },
      { title: "k", hint: "iteration", of: (r) => r.k },
      { title: "theirs", hint: "the program's own score", of: (r) => (r.theirs == null ? "–" : +r.theirs.toPrecision(4)) },
      { title: "ours", hint: "our score of that pose", of: (r) => number(r.ours, 3) },
      { title: "ms", of: (r) => (r.ms ? number(r.ms, 1) : "") },
    ]).filter((c) => c.title !== "ms" || answer.rows.some((r) => r.ms))} />
  </div>`;
}

/**
 * A method of ours, from the poses at the cursor or from the same initial poses.
 * @param {{ moment: Moment }} props
 */
function GoOn({ moment }) {
  const { branch, k, run } = moment;
  const shown = useStore((s) => s.branches.find((b) => b.index === branch));
  const method = state.frame.choices.methods.find((m) => m.name === METHOD);
  if (!shown || shown.method !== "trace" || shown.recording || !method) return null;
  const own = settingsOf(state).find((one) => one.name === "method.iterations").value;
  const spent = state.frame.objects.map((o) => rowsOf(run, o.id).filter((r) => r.k <= k).length / Math.max(o.arms.length, 1));
  const changes = { "method.name": METHOD, "method.iterations": Math.ceil(Math.max(0, ...spent)) + Number(own) };
  return html`<div class="row">
    <${Button} engine kind="primary" title="a new branch, run to its end: its hypotheses are the poses here"
      onClick=${() => send({ verb: "fork", branch, k, changes, run: true })}>Continue from here with ${method.label}<//>
    <${Button} engine title=${`${method.label} from the same initial poses, as B beside the trace`}
      onClick=${() => runBeside(branch, { "method.name": METHOD })}>Compare with ${method.label}<//>
  </div>`;
}

const [W, H, LEFT, BOTTOM, TOP, RIGHT] = [320, 150, 34, 28, 8, 10];
/** @param {{ rows: RecordedPose[], moment: Moment, go: (r: RecordedPose) => void }} props */
function Scatter({ rows, moment, go }) {
  const [low, high] = [Math.min(...rows.map((r) => r.theirs)), Math.max(...rows.map((r) => r.theirs))];
  const top = Math.max(0.1, ...rows.map((r) => r.ours));
  const floor = H - BOTTOM;
  const x = (v) => LEFT + 8 + (high > low ? (v - low) / (high - low) : 0.5) * (W - LEFT - RIGHT - 16);
  const y = (v) => floor - (v / top) * (floor - TOP);
  return html`<svg class="scatter" viewBox=${`0 0 ${W} ${H}`} role="img" aria-label="our score over the recorded one">
    <path d=${`M${LEFT} ${TOP}V${floor}H${W - RIGHT}`} />
    <text x=${LEFT} y=${floor + 12}>${+low.toPrecision(3)}</text><text x=${W - RIGHT} y=${floor + 12} class="end">${+high.toPrecision(3)}</text>
    <text x=${LEFT - 4} y=${floor} class="end">0</text><text x=${LEFT - 4} y=${TOP + 8} class="end">${number(top)}</text>
    <text x=${(LEFT + W) / 2} y=${H - 3} class="middle">recorded score; upwards: ours</text>
    ${rows.map((r) => html`<circle key=${`${r.k} ${r.arm}`} cx=${x(r.theirs)} cy=${y(r.ours)} r="4" fill=${armColor(moment, r.arm)}
      class=${r.k === moment.row?.k ? "current" : ""} onClick=${() => go(r)}>
      <title>hypothesis ${r.arm + 1}, ${r.k ? `iteration ${r.k}: ${r.name}` : "initial pose"}: ${+r.theirs.toPrecision(4)}, ours ${number(r.ours, 3)}</title></circle>`)}
  </svg>`;
}
