// The panel of the layout "Label": models to place, labels of the frame with what speaks for and against them, and steps.
import { html } from "htm/preact";
import { useEffect, useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import { addressOf, send, state, update, useStore, useWant } from "./store.js";
import {
  decide, labelInHand, labelsOf, modelInHand, modelsNamed, nextFrame, progressOf, snap, snapCandidate, take, takeModel,
  takeNext,
} from "./labelling.js";
import { pathOf } from "./outlines.js";
import { photo, shadedOf } from "./sides.js";
import { addKeys } from "./keys.js";
import { Button, counted, Dialog, IconButton, Light, number, Swatch, Toggle } from "./ui.js";

/** @import { CandidatePose, LabelShown, LabelsMessage, OutlinesWanted } from "./messages.d.ts" */

const undo = (redo = false) => send({ verb: "undolabel", redo });
const openNext = () => nextFrame(state) && send({ verb: "open", frame: nextFrame(state) });
const carry = () => send({ verb: "carry" });
// A label is uncertain at once; why is written after.
/** @type {(label: LabelShown | null, setNoting: (on: boolean) => void) => void} */
function doubt(label, setNoting) {
  if (label && label.state !== "uncertain") decide(label, "uncertain", label.note);
  setNoting(Boolean(label));
}

export function Labels() {
  const labels = useStore((s) => s.labels);
  const [noting, setNoting] = useState(false);
  const filter = useRef(null);
  useEffect(() => addKeys(keysOf(() => filter.current?.focus(), () => doubt(labelInHand(state), setNoting))), []);
  if (!labels) return html`<p class="empty">The labels are being read.</p>`;
  return html`<section class="labels-panel">
    <${Models} labels=${labels} filter=${filter} />
    <${List} noting=${noting} setNoting=${setNoting} />
    <${Steps} labels=${labels} />
  </section>`;
}

function keysOf(chooseModel, note) {
  const group = "Label";
  const isStill = () => !state.view.edited;
  return [
    { id: "label-model", keys: ["l"], title: "Choose a model by its name", group, action: chooseModel },
    { id: "label-snap", keys: ["Enter"], title: "Snap: refine, settle and verify the label", group, when: isStill, action: () => snap() },
    { id: "label-accept", keys: ["a"], title: "Accept the label", group, action: () => decide(labelInHand(state), "accepted") },
    { id: "label-uncertain", keys: ["u"], title: "The label is uncertain, with a note", group, action: note },
    { id: "label-remove", keys: ["Delete", "Backspace"], title: "Remove the label", group,
      action: () => decide(labelInHand(state), "removed") },
    { id: "label-next", keys: ["w"], title: "Next label of the frame", group, action: takeNext },
    { id: "label-candidate", keys: ["1", "2", "3", "4", "5"], shown: "1 – 5", title: "Snap from a candidate", group,
      action: (/** @type {KeyboardEvent} */ e) => snapCandidate(Number(e.key)) },
    { id: "label-frame", keys: ["n"], title: "Next frame", group, action: openNext },
    { id: "label-carry", keys: ["N"], title: "Carry the labels on to the frames that follow", group, action: carry },
    { id: "label-undo", keys: ["Ctrl+z"], title: "Undo the last step on labels", group, when: () => isStill() && state.labels?.undo,
      action: () => undo() },
    { id: "label-redo", keys: ["Ctrl+Shift+z", "Ctrl+y"], title: "Redo it", group, when: () => isStill() && state.labels?.redo,
      action: () => undo(true) },
  ];
}

// Models

/** @param {{ labels: LabelsMessage, filter: { current: HTMLInputElement | null } }} props */
function Models({ labels, filter }) {
  const [text, setText] = useState("");
  const [model, placed] = useStore((s) => [modelInHand(s), labelsOf(s)]);
  const shown = modelsNamed(labels.models, text);
  const typed = (/** @type {KeyboardEvent} */ e) => {
    if (e.key !== "Enter" || !shown.length) return;
    if (shown[0] !== model) takeModel(shown[0].obj_id);
    setText("");
    filter.current.blur();
  };
  const card = (/** @type {LabelsMessage["models"][number]} */ one) => {
    const n = placed.filter(({ obj_id }) => obj_id === one.obj_id).length;
    return html`<button type="button" key=${one.obj_id} class=${`model ${one === model ? "on" : ""}`} aria-pressed=${String(one === model)}
      title=${`${one.name}${one.symmetry ? `, symmetric: ${one.symmetry}` : ""}; click, then click it in the photo`}
      onClick=${(e) => { e.currentTarget.blur(); takeModel(one.obj_id); }}>
      <img src=${addressOf(`/model/${one.obj_id}`)} alt="" loading="lazy" draggable=${false} />
      <span>${one.name.replaceAll("_", "_\u200b")}</span>${n > 0 && html`<b title=${`${counted(n, "label")} in this frame`}>${n}</b>`}</button>`;
  };
  return html`<div class="models">
    <header><h2>Models</h2><input ref=${filter} placeholder="name (L)" aria-label="models by name" value=${text} spellcheck=${false}
      onInput=${(e) => setText(e.currentTarget.value)} onKeyDown=${typed} /></header>
    <div class="cards scroll">${shown.map(card)}
      ${!shown.length && html`<p class="dim">${labels.models.length ? "no model by that name" : "the folder has no models"}</p>`}</div></div>`;
}

// Labels of the frame

const STATES = { accepted: "✓ accepted", uncertain: "? uncertain", proposed: "proposed" };

function List({ noting, setNoting }) {
  const [list, inHand, frame] = useStore((s) => [labelsOf(s), labelInHand(s), s.frame]);
  const color = (/** @type {number} */ obj) => frame.objects.find((one) => one.id === obj)?.color;
  return html`<div class="label-list"><header><h2>Labels of ${frame.frame}</h2>${list.length > 0 && html`<span class="dim">${
      list.filter(({ state }) => state === "accepted").length} of ${list.length} accepted</span>`}</header>
    <div class="scroll">${!list.length && html`<p class="empty">Choose a model, then click it in the photo or drag a box around it.</p>`}
      ${list.map((one) => html`<article key=${one.obj} class=${one === inHand ? "on" : ""}>
        <button type="button" class="head" title=${`${one.reasons.join("; ") || "nothing speaks against it"}; ${one.begun}`}
          onClick=${(e) => { e.currentTarget.blur(); setNoting(false); take(one.obj); }}>
          <${Light} tone=${one.light} words /><${Swatch} color=${color(one.obj)} /><b>${one.name.replaceAll("_", "_\u200b")}</b>
          <span class=${`state ${one.state}`} title=${one.note}>${STATES[one.state]}</span></button>
        ${one === inHand && html`<${InHand} label=${one} noting=${noting} setNoting=${setNoting} />`}</article>`)}
    </div></div>`;
}

/** @param {{ label: LabelShown, noting: boolean, setNoting: (on: boolean) => void }} props */
function InHand({ label, noting, setNoting }) {
  const { light, reasons, fit_mm, sinks_mm, undetermined_mm, undetermined_deg, state: decided, note } = label;
  return html`<div class="in-hand">
    ${reasons.length > 0 && html`<ul>${reasons.map((reason) => html`<li>${reason}</li>`)}</ul>`}
    ${note && html`<p class="dim">“${note}”</p>`}
    <p class="figures"><span title="mean distance of measured depth to its surface">fit <b>${number(fit_mm, 1)} mm</b></span>
      <span class=${light === "green" ? "passed" : ""} title="how deep it sinks into its support or a neighbour">sinks <b>${number(sinks_mm, 1)} mm</b></span>
      <span title="how far it could be moved and turned and fit as well">undetermined <b>${number(undetermined_mm, 1)} mm ${
        number(undetermined_deg, 0)}°</b></span></p>
    <div class="group">
      <${Button} title="refine, settle and verify it (Enter)" onClick=${() => snap()}>Snap<//>
      <${Button} kind=${decided === "accepted" ? "" : "primary"} on=${decided === "accepted" || undefined} title="accept it (A); again: leave it open"
        onClick=${() => decide(label, decided === "accepted" ? "proposed" : "accepted")}>Accept<//>
      <${Button} on=${decided === "uncertain" || undefined} title="uncertain, with a note (U); again: leave it open"
        onClick=${() => (decided === "uncertain" ? decide(label, "proposed") : doubt(label, setNoting))}>Uncertain<//>
      <${Button} title="remove it (Delete)" onClick=${() => decide(label, "removed")}>Remove<//></div>
    ${noting && html`<${Note} label=${label} close=${() => setNoting(false)} />`}
    ${label.candidates.length > 0 && html`<${Candidates} label=${label} />`}
  </div>`;
}

/** @param {{ label: LabelShown, close: () => void }} props */
function Note({ label, close }) {
  const field = useRef(null);
  useEffect(() => {
    field.current.value = label.note;
    field.current.focus();
  }, []);
  const key = (/** @type {KeyboardEvent} */ e) => {
    if (e.key === "Escape") field.current.value = label.note;
    if (e.key === "Enter") field.current.blur();
  };
  const left = () => {
    const note = field.current.value.trim();
    if (note !== label.note) decide(label, "uncertain", note);
    close();
  };
  return html`<input class="note" ref=${field} maxlength="400" placeholder="what is uncertain? (Enter)" aria-label="note" onKeyDown=${key} onBlur=${left} />`;
}

// Poses that were searched for, each as a piece of the photo with its model; pointed at, its outline alone.

/** @param {{ label: LabelShown }} props */
function Candidates({ label }) {
  const { obj, candidates } = label;
  const of = useMemo(() => /** @type {OutlinesWanted} */ ({ what: "outlines", obj, poses: candidates.map(({ T }) => T) }), [label]);
  const answer = useWant(of, "candidates");
  const outlines = answer && "outlines" in answer ? answer.outlines : [];
  return html`<div class="candidates">${candidates.slice(0, 5).map((one, i) => html`<${Candidate} key=${i} n=${i + 1} obj=${obj}
    one=${one} polygons=${outlines[i] ?? []} />`)}</div>`;
}

const AROUND = 0.2; // shown around an outline, as a share of its size
/** @param {{ n: number, obj: number, one: CandidatePose, polygons: number[][] }} props */
function Candidate({ n, obj, one, polygons }) {
  const canvas = useRef(null);
  const [bare, setBare] = useState(false);
  const [image, region, model] = useStore(() => {
    const shaded = shadedOf(obj, one.T, `candidate ${n}`);
    return [photo(), shaded?.region, shaded?.image];
  });
  useLayoutEffect(() => {
    if (polygons.length) drawPiece(canvas.current, image, polygons, bare || !model ? null : { region, image: model });
  }, [image, region, model, bare, polygons]);
  return html`<button type="button" title=${`score ${number(one.score, 3)}: snap from here (${n})`}
    onPointerEnter=${() => setBare(true)} onPointerLeave=${() => setBare(false)}
    onClick=${(e) => { e.currentTarget.blur(); snap(one.T); }}><canvas ref=${canvas} width="224" height="168" /><kbd>${n}</kbd></button>`;
}
/** @type {(canvas: HTMLCanvasElement, image: HTMLImageElement | null, polygons: number[][], shaded: ReturnType<typeof shadedOf>) => void} */
function drawPiece(canvas, image, polygons, shaded) {
  const [us, vs] = [0, 1].map((odd) => polygons.flat().filter((_, i) => i % 2 === odd));
  const middle = [us, vs].map((xs) => (Math.min(...xs) + Math.max(...xs) + 1) / 2);
  const { width, height } = canvas;
  const sizes = [us, vs].map((xs) => (1 + 2 * AROUND) * (Math.max(...xs) - Math.min(...xs) + 1));
  const scale = Math.min(width / sizes[0], height / sizes[1]);
  const context = canvas.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.fillStyle = "#26282c";
  context.fillRect(0, 0, width, height);
  context.setTransform(scale, 0, 0, scale, width / 2 - scale * middle[0], height / 2 - scale * middle[1]);
  if (image) context.drawImage(image, 0, 0, state.frame.camera.w, state.frame.camera.h);
  if (shaded) context.drawImage(shaded.image, .../** @type {[number, number, number, number]} */ (shaded.region));
  for (const [color, wide] of /** @type {[string, number][]} */ ([["#000a", 4], ["#ffd23c", 2]])) {
    Object.assign(context, { strokeStyle: color, lineWidth: wide / scale });
    context.stroke(pathOf(polygons));
  }
}

// Steps through the folder, and its ground truth

/** @param {{ labels: LabelsMessage }} props */
function Steps({ labels }) {
  const [frame, isBusy, edits, exports] = useStore((s) => [s.frame, Boolean(s.busy.text), Boolean(s.view.edited), s.overlay === "export"]);
  const { labelled, undecided } = progressOf(labels.frames);
  const none = !labelsOf(state).length;
  return html`<footer class="label-steps">
    <div class="group"><${IconButton} icon="undo" title="undo (Ctrl+Z)" disabled=${!labels.undo || edits} onClick=${() => undo()} />
      <${IconButton} icon="redo" title="redo (Ctrl+Shift+Z)" disabled=${!labels.redo || edits} onClick=${() => undo(true)} />
      <span class="spring" />
      <${Button} title="the next frame (N)" disabled=${!nextFrame(state)} onClick=${openNext}>Next frame<//>
      <${Button} title="carry these labels on to the frames that follow, until one needs you (Shift+N)"
        disabled=${none || isBusy || !nextFrame(state)} onClick=${carry}>Carry on<//>
      <${Button} title="write ground truth of a BOP data set" disabled=${!labelled || isBusy} onClick=${() => update({ overlay: "export" })}>Export…<//></div>
    <p class="dim" title=${labels.file}>${labelled} of ${counted(frame.frames.length, "frame")} labelled${undecided ? html`, <b title="labels that are neither accepted nor uncertain">${counted(undecided, "label")} to look at</b>` : ""}</p>
    ${exports && html`<${Export} labels=${labels} close=${() => update({ overlay: null })} />`}
  </footer>`;
}

/** @param {{ labels: LabelsMessage, close: () => void }} props */
function Export({ labels, close }) {
  const [out, setOut] = useState(labels.export);
  const [uncertain, setUncertain] = useState(false);
  const [overwrite, setOverwrite] = useState(false);
  const [symmetric, setSymmetric] = useState(/** @type {number[]} */ ([]));
  const proposed = labels.models.filter((one) => one.symmetry);
  const isDataset = labels.export !== "" && out.trim() === labels.export;
  const { undecided, uncertain: doubted } = progressOf(labels.frames);
  const leftOut = [undecided && `${counted(undecided, "label")} still proposed`, doubted && !uncertain && `${counted(doubted, "label")} called uncertain`].filter(Boolean);
  const write = () => {
    send({ verb: "export", out: isDataset ? "" : out.trim(), uncertain, symmetries: symmetric, overwrite });
    close();
  };
  return html`<${Dialog} title="Write ground truth" onClose=${close}><div class="export">
    <label><span>Folder</span><input value=${out} spellcheck=${false} onInput=${(e) => setOut(e.currentTarget.value)} /></label>
    <p class="dim">${isDataset ? "The data set itself: scene_gt.json, masks and models_info.json beside its pictures."
      : "A BOP data set with frames, models, ground truth and masks."}</p>
    ${leftOut.length > 0 && html`<p class="left-out">Left out: ${leftOut.join(", ")}.</p>`}
    <${Toggle} value=${uncertain} title="those without a decision are never written" onChange=${setUncertain}>uncertain labels, too<//>
    <${Toggle} value=${overwrite} title="copies are kept" onChange=${setOverwrite}>overwrite files that are there; copies are kept<//>
    ${proposed.length > 0 && html`<h3>Symmetries to confirm</h3><div class="scroll">${proposed.map((one) => html`
      <${Toggle} key=${one.obj_id} value=${symmetric.includes(one.obj_id)} onChange=${(on) =>
        setSymmetric(on ? [...symmetric, one.obj_id] : symmetric.filter((id) => id !== one.obj_id))}><b>${one.name}</b>${" "}<span class="dim">${one.symmetry}</span><//>`)}</div>`}
    <div class="group"><span class="spring" /><${Button} title="write nothing" onClick=${close}>Cancel<//>
      <${Button} kind="primary" title="write the files" disabled=${!out.trim()} onClick=${write}>Write<//></div>
  </div><//>`;
}
