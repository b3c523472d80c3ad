// A stand-in until the real one is merged.
import { html } from "./vendor/htm-preact.js";
import { Pane } from "./ui.js";

export const ScenePane = () => html`<${Pane} name="scene" title="3D"><//>`;
