// The list of objects at the cursor: colour, name, score, error and state; a click puts one in focus.
import { html } from "htm/preact";
import { useStore, setView } from "./store.js";
import { bestWords, momentOf } from "./moment.js";
import { limits, limitWords } from "./palette.js";
import { Icon, number, Swatch, Toggle } from "./ui.js";

const PHASES = {
  waiting: "its turn is still to come", working: "the iteration at the cursor works on it",
    placed: "it stands in the scene",
  "rolled out": "placed to complete the scene", paused: "it waits for its next turn", done: "solved",
    "no pose": "it has no hypothesis",
};

export function Objects() {
  const [moment, obj] = useStore((s) => [momentOf(s), s.view.obj]);
  if (!moment) return null;
  const several = moment.scene.length > 1;
  const pose = bestWords(moment.branch).replace("best", "best pose");
  const hasErrors = moment.scene.some((o) => o.object.has_gt);
  const choose = (id) => setView({ obj: obj === id ? null : id, arm: null, moment: null });
  return html`<section class="objects">
    <div class="scroll"><table class="table"><thead><tr>
      <th class="left">${several ? `${moment.scene.length} objects` : "Object"}</th><th
        title=${`of its ${pose}, 0 to 1`}>score</th>
      ${hasErrors && html`<th title=${`ADD(-S) of its ${pose}; allowed is ${limitWords()}`}>mm</th>`}<th
        class="left">state</th></tr></thead>
    <tbody>${moment.scene.map(({ object, phase, score, err, verdict }) => {
      const right = err == null ? null : err < limits.correct * object.diameter_mm;
      return html`<tr key=${object.id}
        class=${`clickable ${object.id === moment.obj ? "current" : ""} ${object.left_out ? "faint" : ""}`}
        onClick=${() => choose(object.id)} title=${object.left_out || PHASES[phase]}>
        <td class="left"><span class="name"><${Swatch} color=${object.color} />
          <span>${object.label.replaceAll("_", "_\u200b")}</span></span></td>
        <td>${number(score)}</td>
        ${hasErrors && html`<td class=${right == null ? "" : right ? "good" : "bad"}>${number(err, 1)}</td>`}
        <td class="left state">${verdict ? html`<${Verdict}
          tone=${verdict.tone} />` : object.left_out ? "left out" : phase}</td>
      </tr>`;
    })}</tbody></table></div>
    ${several && html`<div class="follow"><${Toggle} value=${obj == null}
      title="show the object that the iteration works on (Esc)"
      onChange=${(v) => setView({ obj: v ? null : moment.obj, arm: null })}>follow the iteration<//></div>`}
  </section>`;
}

const TONES = { right: ["check", "right"], wrong: ["cross", "wrong"], doubt: ["warn", "doubtful"],
  unknown: ["question", "unknown"], none: ["cross", "no pose"] };
/** @param {{ tone: import("./messages.d.ts").JudgedObject["tone"] }} props */
const Verdict = ({ tone }) => html`<span class=${`tone-${tone}`}><${Icon}
  name=${TONES[tone][0]} />${TONES[tone][1]}</span>`;
