// Doubts about the data: badges on the verdict, and below the image what one shows, with the button that puts it right.
import { html } from "htm/preact";
import { send, setView, state, useStore } from "./store.js";
import { closeDoubt, LOOKS, pictureOf, shownDoubt } from "./doubts.js";
import { setPreset } from "./layout.js";
import { Button, Icon, IconButton } from "./ui.js";

/** @import { Moment } from "./moment.js" */

/** @type {(index: number) => void} */
function show(index) {
  if (state.view.doubt === index) return closeDoubt();
  if (state.view.preset === "gallery" || state.view.preset === "report") setPreset("inspect");
  return setView({ doubt: index, zoom: "image", edited: null, full: "image" });
}

// Those of the object in focus and of the whole frame; of the same words one.
/** @param {{ moment: Moment }} props */
export function DoubtBadges({ moment }) {
  const [frame, doubts, shown] = useStore((s) => [s.frame, s.verdicts.get(s.view.branch)?.doubts ?? s.frame?.doubts,
    s.view.doubt]);
  const listed = [...(doubts ?? [])].map((one, index) => ({ one, index }))
    .filter(({ one }) => !one.objs.length || one.objs.includes(moment.obj))
    .filter(({ one }, i, all) => all.findIndex((other) => other.one.title === one.title) === i);
  const mended = Object.keys(frame?.as_read ?? {});
  return html`${listed.map(({ one, index }) => html`<button type="button" key=${`doubt ${index}`}
      class=${`doubt-badge ${shown === index ? "on" : ""}`} title=${`${one.text}; click: what shows it`}
      onClick=${(e) => { e.currentTarget.blur(); show(index); }}><${Icon} name="warn" />${one.title}</button>`)}
    ${mended.length > 0 && !state.file && html`<button type="button" class="doubt-badge mended"
      title=${`put right by ${mended.join(", ")}; click: restart with the data as they were read`}
      onClick=${(e) => { e.currentTarget.blur(); restart(frame.as_read, false); }}>
      <${Icon} name="check" />data put right</button>`}`;
}

const wordsOf = (changes) => Object.entries(changes).map(([name, v]) => `${name} = ${JSON.stringify(v)}`).join(", ");
const restart = (changes, run) => send({ verb: "restart", branch: state.view.branch, changes, run });

// Below the image: what it shows, in a sentence, and what puts the data right.
export function DoubtCard() {
  const [one, answer] = useStore((s) => [shownDoubt(s), pictureOf()]);
  if (!one) return null;
  const roles = Object.entries(LOOKS).map(([role, { color }]) => ({ role, color, of: (answer?.shapes ?? []).filter((x) => x.role === role) }));
  return html`<div class="doubt-card">
    <div class="group"><b><${Icon} name="warn" />${one.title}</b>
      ${roles.filter(({ of }) => of.length).map(({ role, color, of }) => html`<span key=${role} class="key">
        <i style=${{ color }} />${of[0].label}${of.some((x) => x.polygons.length) ? "" : " (not in the image)"}</span>`)}
      ${one.picture === "scene" && html`<span class="dim">look at the plane in 3D</span>`}
      <span class="spring" /><${IconButton} icon="cross" title="close (Esc)" onClick=${closeDoubt} /></div>
    <p>${one.text[0].toUpperCase() + one.text.slice(1)}.</p>
    ${one.put_right && html`<${Button} engine kind="primary" title=${`restarts the run with ${wordsOf(one.put_right)}; files stay as they are`}
      onClick=${() => restart(one.put_right, true)}>Put right and run<//>`}
  </div>`;
}
