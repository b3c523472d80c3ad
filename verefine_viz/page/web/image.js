// A stand-in until the real one is merged.
import { html } from "./vendor/htm-preact.js";
import { Pane } from "./ui.js";

export const ImagePane = () => html`<${Pane} name="image" title="Image"><//>`;
