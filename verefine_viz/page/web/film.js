// The film: key moments of the object in focus, once its run is over. A click goes to one; the strip folds away.
import { html } from "htm/preact";
import { addressOf, send, setView, state, useStore, useWant } from "./store.js";
import { momentOf } from "./moment.js";
import { seek } from "./cursor.js";
import { Button, IconButton, Swatch } from "./ui.js";
import { remember } from "./layout.js";

/** @import { FilmWanted, JudgedObject, MomentShown } from "./messages.d.ts" */

// What is asked for the pictures of a film: the same object as long as the verdict is.
/** @type {WeakMap<readonly MomentShown[], FilmWanted>} */
const wanted = new WeakMap();
/** @type {(branch: number, judged: JudgedObject) => FilmWanted} */
function wantOf(branch, { obj, film }) {
  if (!wanted.has(film)) wanted.set(film, { what: "film", obj, branch, moments: film.map((one) => one.drawn) });
  return wanted.get(film);
}

/**
 * Goes to a moment of an object, with the tab that pictures it.
 * @param {number} obj
 * @param {{ k: number, stage: string | null, tab?: string }} moment
 */
export function goTo(obj, { k, stage, tab }) {
  seek(k);
  setView({ obj, arm: null, stage, a: null, b: null, ...(tab ? { tab } : {}) });
}
// Where a finding stands at a stage, its tab says more.
/** @type {(judged: JudgedObject, moment: MomentShown) => void} */
const show = ({ obj, findings }, { k, stage }) =>
  goTo(obj, { k, stage, tab: stage ? findings.find((one) => one.k === k)?.tab_there : "" });

// A name that is an ending alone leaves the rest to the server.
const save = (/** @type {number} */ obj, name = "") => send({ verb: "save", what: "film", branch: state.view.branch, obj, name });
const hex = (/** @type {[number, number, number]} */ color) => `rgb(${color.join()})`;

export function Film() {
  const [moment, folded, stage] = useStore((s) => [momentOf(s), s.filmFolded, s.view.stage]);
  const isShown = useStore((s) => !s.view.full && !["gallery", "label", "maps", "report"].includes(s.view.preset));
  const judged = isShown && moment?.over ? moment.verdict : null;
  const film = judged?.film ?? [];
  const pictures = useWant(film.length && !folded ? wantOf(moment.branch, judged) : null, "film");
  if (!film.length) return null;
  const current = film.findIndex((one) => one.k === moment.k && one.stage === stage);
  const urls = pictures && "urls" in pictures ? pictures.urls : [];
  return html`<section class=${`film ${folded ? "folded" : ""}`} aria-label="Film">
    <div class="fold">
      <${IconButton} icon=${folded ? "down" : "up"} title=${folded ? "How the answer came about, in pictures" : "Fold the film away"}
        onClick=${() => remember({ filmFolded: !folded })} />${folded && "Film"}
      ${!folded && !state.file && html`<${Button} title="Download the film as one picture" onClick=${() => save(judged.obj)}>PNG<//>
        <${Button} title="Download the film as an animation" onClick=${() => save(judged.obj, "_film.gif")}>GIF<//>`}
    </div>
    ${!folded && html`<div class="moments">${film.map((one, i) => html`<button type="button" key=${i}
      class=${`moment ${i === current ? "current" : ""}`} title=${`${one.title}: ${one.caption}`}
      onClick=${(/** @type {MouseEvent & { currentTarget: HTMLElement }} */ e) => { e.currentTarget.blur(); show(judged, one); }}>
      <b class="line">${one.title}</b>
      <span class="line">${one.legend.map(([name, color]) => html`<i><${Swatch} color=${hex(color)} />${name}</i>`)}</span>
      ${urls[i] ? html`<img src=${addressOf(urls[i])} alt="" draggable=${false} />` : html`<span class="still" />`}
      <span class="caption">${one.caption}</span></button>`)}</div>`}
  </section>`;
}
