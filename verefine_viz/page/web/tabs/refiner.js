// What a learned refiner saw and answered, step by step.
import { html } from "htm/preact";
import { addressOf, useStore } from "../store.js";
import { momentOf } from "../moment.js";
import { cropsOf } from "../wants.js";
import { useLatest } from "./latest.js";

export const title = "Refiner";
export const hint = "what a learned refiner saw and answered";
export const needs = (/** @type {import("../store.js").State} */ s) => {
  const moment = momentOf(s);
  return Boolean(moment?.row?.stages.some((stage) => stage.name === "refined") && s.branches.find((one) => one.index === moment.branch)?.explains);
};
/** @param {import("../store.js").State} s */
export const empty = (s) => (momentOf(s)?.row ? "The refiner is not learned: there are no pictures that it saw." : "Nothing was refined yet.");

export function render() {
  const moment = useStore(momentOf);
  const answer = useLatest(cropsOf(moment), "crops", `${moment.branch} ${moment.obj}`);
  if (!answer) return html`<p class="empty">Asking the refiner what it saw.</p>`;
  if ("gone" in answer) return html`<p class="empty">${answer.gone}</p>`;
  if (answer.empty) return html`<p class="empty">${answer.empty}</p>`;
  return html`<div class="tab refiner">
    <p class="summary">${answer.refiner} in iteration ${answer.k}${answer.start ? `: ${answer.start}` : ""}.</p>
    ${answer.steps.map((step, i) => html`<figure key=${step.url}><img src=${addressOf(step.url)} alt=${`what the refiner saw at step ${i + 1}`} />
      <figcaption><b>Step ${i + 1} of ${answer.steps.length}</b>${step.words.map((line) => html`<span>${line}</span>`)}</figcaption></figure>`)}
    <p class="dim">White line: the shift that it answered. Yellow: the axis of its turn, longer for larger turns.</p>
  </div>`;
}
