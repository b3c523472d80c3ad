// A stand-in until the real one is merged.
import { html } from "./vendor/htm-preact.js";

export const ImagePane = () => html`<p class="empty">pictures</p>`;
