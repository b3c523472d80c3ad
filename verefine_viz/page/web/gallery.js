// A stand-in until the real one is merged.
import { html } from "./vendor/htm-preact.js";

export const Gallery = () => html`<p class="empty">gallery</p>`;
