// A stand-in until the real one is merged.
import { html } from "./vendor/htm-preact.js";
import { Pane } from "./ui.js";

export const MapsPane = () => html`<${Pane} name="maps" title="Score maps"><//>`;
