// The objects over the frames of a sequence, beside the frame that is open.
import { html } from "htm/preact";
import { momentOf } from "../moment.js";
import { Sequence } from "../sequence.js";

export const title = "Track";
export const hint = "the objects over the frames of a sequence";
/** @param {import("../store.js").State} s */
export const needs = (s) => (s.frame?.frames.length ?? 0) > 1 && momentOf(s) != null;
export const empty = "One frame: no sequence.";

export const render = () => html`<div class="tab track"><${Sequence} small /></div>`;
