// A stand-in until the real one is merged.
import { html } from "./vendor/htm-preact.js";

export const ScenePane = () => html`<p class="empty">3D</p>`;
