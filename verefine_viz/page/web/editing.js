// Editing a pose, in the photo or in 3D: its moves with undo and redo, the bar under the photo with the result of
// refining it, and the branches that begin there.
import { html } from "htm/preact";
import { useEffect, useState } from "preact/hooks";
import { state, setView, send, listen, useStore } from "./store.js";
import { momentOf, rowsOf, samePose } from "./moment.js";
import { Button, IconButton, Select, Swatch } from "./ui.js";
import { addKeys } from "./keys.js";
import { toast } from "./toasts.js";
import { stageColor } from "./palette.js";
import { sidesOf } from "./sides.js";
import { endOf } from "./wants.js";
import { isLabelling, labelInHand, snap as snapLabel } from "./labelling.js";
import { moved, redone, rested, undone } from "./edit_history.js";
import { between, displaced, displacement, origin, receded, shifted, turned } from "./pose.js";

const STEP_M = 0.5e-3; // of an arrow key
const STEP_RAD = (0.5 * Math.PI) / 180;
const PAUSE_MS = 100; // without a move, after which the result of refining is requested

const editable = ({ poses }) => (state.view.edited ? null : poses.edited) ?? poses.accepted ?? poses.current ?? poses.best ?? poses.initial;
export function edit() {
  const moment = momentOf(state);
  const pose = moment && editable(moment);
  if (pose?.T) setView({ edited: { obj: moment.obj, arm: pose.arm ?? moment.arm, T: pose.T, from: pose.T } });
}
export const toggleEdit = () => (state.view.edited ? setView({ edited: null }) : edit());

/** @type {(T: import("./messages.d.ts").Pose, gesture?: string | null) => void} */
export function moveTo(T, gesture = null) {
  const edited = { from: editable(momentOf(state)).T, ...state.view.edited };
  setView({ edited: moved(edited, T, gesture) });
}
export const turnedBy = (T, across, down) => turned(turned(T, [0, -1, 0], across), [1, 0, 0], down);

// Arrows: x and y in the image; with Shift, turns as a Shift-drag; with Ctrl, depth, and a turn about the line of sight.
function nudge(event, x, y) {
  if (!state.view.edited) edit(); // a label needs no "edit" first
  const { T } = state.view.edited;
  if (event.shiftKey) moveTo(turnedBy(T, x * STEP_RAD, y * STEP_RAD));
  else if (event.ctrlKey || event.metaKey) moveTo(x ? turned(T, origin(T), x * STEP_RAD) : receded(T, -y * STEP_M));
  else moveTo(shifted(T, [x * STEP_M, y * STEP_M, 0]));
}
const undo = () => setView({ edited: undone(state.view.edited) });
const redo = () => setView({ edited: redone(state.view.edited) });
const snap = () => {
  if (isLabelling(state)) return snapLabel();
  const end = endOf(state, momentOf(state));
  return end && moveTo(end.T);
};

// Begins a run at the edited pose: one of its own, or the rest of this one.
function refineHere({ branch, k }) {
  const { obj, T } = state.view.edited;
  send({ verb: "refine", branch, k, obj, T, run: true });
}
function goOn({ branch, k }) {
  const { obj, arm, T } = state.view.edited;
  // The server removes the edited pose from the view once it is in a branch.
  send({ verb: "fork", branch, k, changes: {}, edit: { obj, arm, T } });
}
const hasIterationsLeft = ({ run, obj, k }) => !run.over || rowsOf(run, obj).some((row) => row.k > k);

// After a pause the result of refining is requested, and the next move is a new step of undo.
let last = null; // the pose at the last call of the listener
let timer = null;
listen(() => {
  const T = state.view.edited?.T ?? null;
  if (T === last) return;
  last = T;
  clearTimeout(timer);
  if (T) timer = setTimeout(() => state.view.edited && setView({ edited: rested(state.view.edited) }), PAUSE_MS);
});

// A moved pose that is dropped because another moment is shown can be restored.
let lastView = state.view;
listen(() => {
  const [before, now] = [lastView, state.view];
  lastView = now;
  const { edited, branch, k } = before;
  const isLost = edited?.from && !now.edited && now.branch === branch && now.k !== k && state.frame;
  if (!isLost || edited.T.every((x, i) => Math.abs(x - edited.from[i]) < 1e-5)) return;
  const { id } = state.frame;
  const back = () => state.frame?.id === id && setView({ branch, k, obj: edited.obj, stage: null, moment: null, edited });
  toast("note", "The edited pose was left.", { offer: { words: "Take it back", action: back } });
});

// Keys

const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const arrows = (prefix, title) => Object.entries(WAYS).map(([key, way]) =>
  ({ id: `${prefix}${key}`, keys: [`${prefix}${key}`], title, group: "Image", action: (event) => nudge(event, ...way) }));
const ARROWS = [
  ...arrows("", "Move the edited pose by 0.5 mm; with Shift turn it by 0.5°"),
  ...arrows("Ctrl+", "The edited pose 0.5 mm nearer or farther, or 0.5° about the line of sight"),
];
const KEYS = [
  { id: "undo", keys: ["Ctrl+z"], title: "Undo a move of the edited pose", group: "Image", action: undo },
  { id: "redo", keys: ["Ctrl+Shift+z", "Ctrl+y"], title: "Redo it", group: "Image", action: redo },
  { id: "snap", keys: ["Enter"], title: "Take the pose where refining ends", group: "Image", action: snap },
];
export function useEditKeys() {
  const [edits, isOver, labels] = useStore((s) => [Boolean(s.view.edited), s.hoverIn === "image", Boolean(labelInHand(s))]);
  useEffect(() => (edits ? addKeys(KEYS) : undefined), [edits]);
  const takesArrows = (edits && isOver) || labels;
  useEffect(() => (takesArrows ? addKeys(ARROWS) : undefined), [takesArrows]);
}

// The bar under the photo

// Shift and turn since the editing began, to read and to type.
function Displacement({ from, T }) {
  const [axes, setAxes] = useState("camera");
  const [shift, turn] = displacement(from, T, axes);
  const field = (value, i, list, type) => html`<input key=${i} type="text" inputmode="decimal" aria-label=${`${type} ${"xyz"[i]}`}
    title=${`${type} ${"xyz"[i]}`} value=${(Math.round(value * 100) / 100 + 0).toString()} onChange=${(e) => {
      const typed = Number(e.currentTarget.value.replace("−", "-"));
      const next = list.map((x, j) => (j === i ? typed : x)); // numbers not typed keep their hidden decimals
      const most = type === "moved" ? 10000 : 180;
      if (Number.isFinite(typed) && Math.abs(typed) <= most) moveTo(displaced(from, ...(list === shift ? [next, turn] : [shift, next]), axes));
      e.currentTarget.value = value.toFixed(2);
    }} />`;
  return html`<span class="numbers"><${Select} value=${axes} options=${[["camera", "camera axes"], ["object", "object axes"]]} onChange=${setAxes}
      title="camera: x to the right, y down, z away. object: those of its model, as it was" />
    mm ${shift.map((v, i) => field(v, i, shift, "moved"))} ° ${turn.map((v, i) => field(v, i, turn, "turned"))}</span>`;
}

const fitWords = ({ depth_fit: depth, normal_fit: normals }) =>
  (depth == null ? "" : `d ${depth.toFixed(2)} n ${normals.toFixed(2)}`);
const HOW = "drag: move · wheel: depth · Shift: turn · Alt: spin. Arrows: 0.5 mm, with Shift 0.5°, with Ctrl depth and spin";

// The result of refining from here, and whether that pose is stable.
function RefinedFromHere({ T }) {
  const [end] = useStore((s) => [momentOf(s) && endOf(s, momentOf(s))]);
  const way = end && between(T, end.T);
  return html`<div class="end"><${Swatch} color=${stageColor("refined")} hollow /><span>refined from here</span>
    <b>${end ? end.score.score.toFixed(3) : "…"}</b>
    ${end && html`<i title="fit of depth and of normals">${fitWords(end.score)}</i>
      <i title="how far from the edited pose">${way.mm.toFixed(1)} mm ${way.deg.toFixed(1)}°</i>
      ${end.tone !== "grey" && html`<i class=${`light ${end.tone}`} title=${end.words} />`}`}
    ${!isLabelling(state) && html`<${Button} title="take this pose (Enter)" disabled=${!end} onClick=${snap}>Snap<//>`}</div>`;
}

// The change since the beginning, and the present score.
function EditedPose({ from, edit, before }) {
  const [a, b] = useStore((s) => ["a", "b"].map((x) => sidesOf(momentOf(s))[x]));
  const { mm, deg } = between(from, edit.T);
  const now = [a, b].find((side) => side?.pose.name === "edited");
  const known = now && !now.stale ? now.score : null;
  return html`<div title=${HOW}><span>${isLabelling(state) ? "" : `hyp. ${edit.arm + 1} `}moved</span><b>${mm.toFixed(1)} mm</b><b>${deg.toFixed(1)}°</b>
    <span>score</span><b>${known ? known.score.toFixed(3) : "…"}</b>
    ${known && html`<i title="fit of depth and of normals">${fitWords(known)}</i>`}
    ${before != null && html`<i>from ${before.toFixed(3)}</i>`}</div>`;
}

export function EditBar() {
  const [moment, edit] = useStore((s) => [momentOf(s), s.view.edited]);
  const [types, setTypes] = useState(false);
  if (!edit || !moment) return null;
  const { T, from = editable(moment).T, past = [], future = [] } = edit;
  return html`<div class="editing">
    <${EditedPose} from=${from} edit=${edit} before=${editable(moment).score} />
    <${RefinedFromHere} T=${T} />
    ${types && html`<div><${Displacement} from=${from} T=${T} /></div>`}
    <div>${isLabelling(state)
      ? html`<${Button} kind="primary" title="refine, settle and verify the label from here (Enter)" onClick=${snap}>Snap<//>`
      : html`<${Button} engine kind="primary" title="a new branch in which this pose is the object's only hypothesis"
        onClick=${() => refineHere(moment)}>Refine this pose<//>`}
      ${!isLabelling(state) && hasIterationsLeft(moment) && html`<${Button} engine title="a new branch: the run goes on from this pose"
        onClick=${() => goOn(moment)}>Continue from here<//>`}
      <${IconButton} icon="undo" title="undo (Ctrl+Z)" disabled=${!past.length} onClick=${undo} />
      <${IconButton} icon="redo" title="redo (Ctrl+Shift+Z)" disabled=${!future.length} onClick=${redo} />
      <${Button} title="move and turn by numbers" on=${types} onClick=${() => setTypes(!types)}>mm °<//>
      <${Button} title="back to where it began" disabled=${samePose(from, T)} onClick=${() => moveTo(from)}>Reset<//>
      <${Button} title="stop editing (Esc)" onClick=${() => setView({ edited: null })}>Cancel<//></div>
  </div>`;
}
