// A stand-in until the real one is merged.
import { html } from "./vendor/htm-preact.js";

export const MapsPane = () => html`<p class="empty">maps</p>`;
