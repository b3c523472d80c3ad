// All settings: change some, then restart, fork at the cursor, or run beside; other initial poses by an estimator.
import { html } from "htm/preact";
import { useState } from "preact/hooks";
import { send, state, update, useStore } from "../store.js";
import { momentOf } from "../moment.js";
import { Button, IconButton, Select } from "../ui.js";
import { runBeside } from "./beside.js";
import { Field, listOf, longName, parsed, sectionOf, settingsOf, shortName, shown } from "./setting.js";

/** @import { FrameMessage } from "../messages.d.ts" */
/** @import { Moment } from "../moment.js" */

export const title = "Settings";
export const hint = "settings of the method, the score and physics";
export const needs = (/** @type {import("../store.js").State} */ s) => Boolean(s.frame);
export const empty = "Nothing is open.";

const ESTIMATORS = { ppf: "point pair features", pcs: "congruent point sets", densefusion: "DenseFusion", session: "the session's own" };

const differs = (setting, value) => value !== setting.value && parsed(setting, String(value)) !== setting.value;
const edit = (setting, value) => {
  const draft = { ...state.draft, [setting.name]: value };
  if (!differs(setting, value)) delete draft[setting.name];
  update({ draft });
};

export function render() {
  const [frame, branches, branch, typed] = useStore((s) => [s.frame, s.branches, s.view.branch, s.draft]);
  const moment = useStore(momentOf);
  const [filter, setFilter] = useState("");
  const [more, setMore] = useState(false);
  const settings = settingsOf(state);
  // A branch may hold already what was typed.
  const changed = settings.filter((one) => one.name in typed && differs(one, typed[one.name]));
  const draft = Object.fromEntries(changed.map((one) => [one.name, typed[one.name]]));
  const changes = Object.fromEntries(changed.map((one) => [one.name, one.kind === "bool" || one.kind === "choice" ? draft[one.name] : parsed(one, String(draft[one.name]))]));
  const wrong = Object.values(changes).includes(undefined);
  const fixed = changed.filter((one) => !one.can_fork);
  const words = filter.toLowerCase();
  const matches = (one) => `${one.name} ${longName(one.name)} ${one.help}`.toLowerCase().includes(words);
  const listed = settings.filter((one) => (words ? matches(one) : more || one.common || one.name in draft || one.value !== one.standard));
  const groups = Object.entries(Object.groupBy(listed, (one) => sectionOf(one.name)));
  const none = changed.length === 0;
  const isEnd = moment.over && moment.k === moment.run.rows.length;
  const forked = isEnd ? "nothing is left to run after the last iteration: go to an earlier one"
    : fixed.length ? `${fixed.map((one) => shortName(one.name)).join(", ")}: only from the start`
      : `keeps the iterations up to ${moment.k}, goes on as a new branch and runs to its end`;
  const others = branches.length > 1 ? `; ${branches.length === 2 ? "the other branch is" : "the other branches are"} discarded` : "";
  return html`<div class="tab settings">
    <div class="apply">
      <div class="row">
        <${Button} engine disabled=${wrong} title=${`from before iteration 1${none ? "" : ` with ${listOf(changes)}`}${others}`}
          onClick=${() => send({ verb: "restart", branch, changes })}>${none ? "Restart" : "Restart with these"}<//>
        <${Button} engine disabled=${wrong || isEnd || fixed.length > 0} onClick=${() => send({ verb: "fork", branch, k: moment.k, changes, run: true })}
          title=${forked}>
          Fork at ${moment.k}<//>
        <${Button} engine disabled=${wrong || none} title="from the start, as B beside this run" onClick=${() => runBeside(branch, changes)}>Run as B beside<//>
        <span class="spring" />
        ${!none && html`<${Button} title="forget the changes" onClick=${() => update({ draft: {} })}>Reset<//>`}
      </div>
      <p class=${none ? "dim" : ""}>${none ? "Change a setting, then choose what to do with it." : changed.map((one) => html`<span class="change">${shortName(one.name)}: ${shown(one.value)} → <b>${shown(draft[one.name])}</b></span>`)}</p>
    </div>
    <input class="filter" placeholder="filter all ${settings.length} settings" value=${filter} onInput=${(e) => setFilter(e.currentTarget.value)} />
    ${groups.map(([section, list]) => html`<section key=${section}><h3>${section}</h3>
      ${list.map((one) => html`<div key=${one.name} class=${`setting-row ${one.name in draft ? "changed" : one.value !== one.standard ? "apart" : ""}`} title=${`${one.name}${one.help ? `: ${one.help}` : ""}${one.can_fork ? "" : " (only from the start)"}`}>
        <label>${shortName(one.name)}</label><${Field} setting=${one} value=${draft[one.name] ?? one.value} onChange=${(value) => edit(one, value)} />
        <${Undo} setting=${one} isTyped=${one.name in draft} /></div>`)}
    </section>`)}
    ${!listed.length && html`<p class="dim">No setting is named so.</p>`}
    ${!words && html`<${Button} title=${more ? "list fewer" : "list all"} onClick=${() => setMore(!more)}>${more ? "The common ones only" : `All ${settings.length} settings`}<//>`}
    <${Estimate} moment=${moment} frame=${frame} branch=${branch} />
  </div>`;
}

/**
 * Takes back what was typed, or else what the run has otherwise than its preset.
 * @param {{ setting: import("../messages.d.ts").EditableSetting, isTyped: boolean }} props
 */
function Undo({ setting, isTyped }) {
  if (state.file || (!isTyped && setting.value === setting.standard)) return html`<span />`;
  const [to, whose] = isTyped ? [setting.value, "the run has"] : [setting.standard, "the preset has"];
  return html`<${IconButton} icon="undo" title=${`back to ${shown(to)}, which ${whose}`} onClick=${() => edit(setting, to)} />`;
}

/** @param {{ moment: Moment, frame: FrameMessage, branch: number }} props */
function Estimate({ moment, frame, branch }) {
  const [by, setBy] = useState("ppf");
  const options = frame.choices.estimators.map((id) => [id, ESTIMATORS[id] ?? id]);
  return html`<section><h3>Other initial poses for ${moment.object.label}</h3>
    <div class="row"><${Select} value=${by} options=${options} onChange=${setBy} title="what estimates them" />
      <${Button} engine title="new initial poses for this object on this frame, as a new branch" onClick=${() => send({ verb: "estimate", branch, obj: moment.obj, estimator: by })}>Estimate<//></div>
  </section>`;
}
