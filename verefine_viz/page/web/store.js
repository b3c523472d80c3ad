// All that the page knows, in one place: what the server sent, and what this window looks at.
import { useState, useLayoutEffect, useRef } from "preact/hooks";

/**
 * @import {
 *   AnswersMessage, AnyAnswer, AnyMessage, AnyVerb, AnyWant, BranchListed, BusyMessage, ComparedBranches,
 *   FileMessage, FixMessage, FrameMessage, GoneAnswer, Grasp, IterationRow, LabelsMessage, Mark, OfferedVerb, Pose, ReportMessage,
 *   RunMessage, RunningMessage, VerdictMessage, WrittenMessage
 * } from "./messages.d.ts"
 */

/**
 * A branch's run: a new object each time rows come, although `rows` is one growing array.
 * @typedef {object} Run
 * @property {IterationRow[]} rows
 * @property {number} total  iterations at its end
 * @property {boolean} over
 * @property {Mark[]} marks
 * @property {string[]} notes
 * @property {string} missing  what a recording lacks at its end; "" where it is complete
 * @property {RunMessage["start"]} start  initial poses by object, where they differ from the frame's
 */

/**
 * A pose that is being edited.
 * @typedef {object} Edited
 * @property {number} obj
 * @property {number} arm  the hypothesis
 * @property {Pose} T
 * @property {Pose} [from]  where the editing began
 * @property {Pose[]} [past]  earlier poses, to which undo returns, the latest last
 * @property {Pose[]} [future]  poses that were undone, the next first
 * @property {string | null} [gesture]  the current movement, whose poses are one step of undo
 * @property {boolean} [rests]  whether it has not been moved for a moment
 */

/**
 * What the image pane shows; image.js has the defaults.
 * @typedef {object} Layers
 * @property {"photo" | "depth"} under
 * @property {string} over  none, shaded, or the name of a map
 * @property {"a" | "b" | null} side  whose map or model `over` shows; null = the pose that is not ground truth
 * @property {number} opacity
 * @property {"off" | "photo" | "ab"} wipe  photo: picture | overlay; ab: A | B
 * @property {number} at  place of the divider, as a share of the width
 * @property {"photo" | "a" | "b" | null} blink  what is shown just now, the photo or a shaded model; null = nothing blinks
 * @property {string[]} hidden  outlines by their keys
 */

/**
 * What the 3D view shows; scene_layers.js has the defaults.
 * @typedef {object} Scene
 * @property {string[]} hidden  layers by their keys
 * @property {import("./messages.d.ts").SceneLook["cloud"]} cloud  what the observed points are coloured by
 * @property {number} box  side of the box around the object in focus to which the view is limited [diameters]
 * @property {number} cut  share of the object in focus that is cut away
 * @property {number} gizmo  size of the handles of an edited pose [px]
 */

/**
 * What this window looks at.
 * @typedef {object} View
 * @property {number} branch
 * @property {number} k  the iteration; beyond the last one, the run's end
 * @property {string | null} stage  last stage of iteration k that is shown; null = the whole iteration
 * @property {number | null} obj  null = the object of the iteration
 * @property {number | null} arm  null = the hypothesis of the iteration
 * @property {number | null} moment  of the simulated path; null = it is not drawn
 * @property {Edited | null} edited
 * @property {number | null} doubt  index of the doubt about the data that the image shows
 * @property {string | null} a  stages that are compared; null = the most telling ones
 * @property {string | null} b
 * @property {number | null} beside  iteration of the run beside it; null = the same
 * @property {Omit<Grasp, "T"> | null} grasp  the grasp that is drawn
 * @property {boolean | null} allowed  whether the poses are drawn that the image allows; null = where the verdict asks for it
 * @property {boolean | null} axes  whether the axes of A and B are drawn; null = where the answer is turned by far
 * @property {boolean} together  all objects in one depth buffer, instead of the one in focus
 * @property {[number, number] | null} pixel  the marked one, [u, v]
 * @property {[[number, number], [number, number]] | null} ruler
 * @property {boolean} measuring  whether a second marked pixel gives a distance
 * @property {Partial<Layers>} layers  what differs from the defaults
 * @property {Partial<Scene>} scene  what differs from the defaults
 * @property {{ share: number, u: number, v: number } | "image" | null} zoom  of the image: its scale relative to the
 *   fitted image and the pixel in the middle; null = the object is fitted in
 * @property {number | null} model  obj_id of the model that the next press in the photo places
 * @property {boolean} scribbles  whether a drag places by a scribble, instead of a box
 * @property {string | null} largeMap  the map that fills the maps pane
 * @property {string | null} tab  null = the most telling one
 * @property {string} preset  of the layout
 * @property {string | null} full  the pane that fills the middle
 */

/**
 * The choices made in the gallery.
 * @typedef {object} GalleryView
 * @property {boolean} begun  whether answers have come
 * @property {string} order
 * @property {Record<string, string[]>} only  filter → values, any of which passes
 * @property {string} search
 * @property {Set<number>} selected  keys of answers
 * @property {number | null} at  the answer that keys move from
 * @property {boolean} tagging  whether a tag is typed
 * @property {{ frame: number | undefined, to: string } | null} leaving  the frame that was open when an answer was asked
 *   for, and the preset that it is shown in
 */

/**
 * The view of a sequence's frames.
 * @typedef {object} SequenceView
 * @property {boolean} on  whether it replaces the gallery's cards
 * @property {string} run  of the batch; "" = that of the open frame
 * @property {number | null} scene  null = that of the open frame
 * @property {string} by  the measure that cells are coloured by; "" = the first that is known
 * @property {number} from  the frames in sight
 * @property {number} to  Infinity = all, also those to come
 * @property {number} lane  the one whose curves are drawn
 * @property {[number, number] | null} brush  the span of frames that is summed up, both ends included; null = all
 */

/**
 * Links, as in the page's address (address.js).
 * @typedef {object} Links
 * @property {string} given  the link with which the page was opened; "" = none
 * @property {string | null} opening  the link still being opened, during which the address is not overwritten
 * @property {string | null} written  what the address holds
 * @property {string | null} lost  the view at the time when the connection was lost
 */

/**
 * A short message in a corner.
 * @typedef {object} Toast
 * @property {number} id
 * @property {"note" | "error"} kind
 * @property {string} text
 * @property {string} [url]  what can be downloaded, and its name
 * @property {string} [name]
 * @property {OfferedVerb | { words: string, action: () => void } | null} [offer]  what can be done instead
 */

/**
 * @typedef {object} State
 * @property {"opening" | "open" | "lost"} connection  open: all that the server knows has come
 * @property {number | null} window  this window's number
 * @property {string | null} version  of the program
 * @property {FileMessage | null} file  content of a page that is a file; null = there is a server
 * @property {FrameMessage | null} frame
 * @property {BranchListed[]} branches
 * @property {ComparedBranches | null} compare  the runs that stand side by side
 * @property {Map<number, Run>} runs  by branch
 * @property {Map<number, VerdictMessage>} verdicts  by branch
 * @property {AnswersMessage | null} answers  of a batch
 * @property {ReportMessage | null} report
 * @property {FixMessage | null} fix  the trial of remedies on the answers
 * @property {{ shown: boolean, row: number | null, chosen: string[], file: string }} remedies  whether their table is
 *   shown, whose answers are listed, which are to be written, where to
 * @property {LabelsMessage | null} labels  of a folder that is labelled
 * @property {import("./labelling.js").Sketch | null} sketch  what is being drawn in the photo to place a model
 * @property {boolean} placing  whether a model was placed and the label is yet to come
 * @property {BusyMessage} busy  progress of long work
 * @property {RunningMessage} running  the branches being computed
 * @property {number | null} scene3d  the window that the 3D view follows
 * @property {WrittenMessage[]} written  files, the latest last
 * @property {Toast[]} toasts
 * @property {View} view
 * @property {Links} link
 * @property {GalleryView} gallery
 * @property {SequenceView} sequence
 * @property {{ was: ComparedBranches | null, asked: number | null, began: boolean } | null} finishing  A and B, which are
 *   computed to their ends: what was compared before, the branch whose turn it is, whether it runs
 * @property {boolean} replaying  whether known rows are played
 * @property {Record<string, unknown>} draft  typed settings that are not in use yet, by name
 * @property {[number, number] | null} hover  the pixel under the mouse
 * @property {string | null} hoverIn  the pane it is in, if that takes keys of its own
 * @property {string | null} lastPane  the pane that the mouse was over last
 * @property {"help" | "palette" | "export" | null} overlay
 * @property {Set<string> | null} hiddenTones  of the timeline's marks; null = until some are chosen
 * @property {"light" | "dark"} theme
 * @property {Record<string, Record<string, number> | undefined>} sizes  of panes by preset, and this, as below,
 *   remembered by the browser (layout.js)
 * @property {number} speed  iterations a second of a replay
 * @property {"score" | "rank" | "error"} colorBy  what colours on the timeline say
 * @property {string[]} hiddenMaps  names
 * @property {boolean} filmFolded
 * @property {number | null} filmOf  the card of the gallery whose film is shown
 */

/** @type {State} */
export const state = {
  connection: "opening",
  window: null,
  version: null,
  file: null,
  frame: null,
  branches: [],
  compare: null,
  runs: new Map(),
  verdicts: new Map(),
  answers: null,
  report: null,
  fix: null,
  remedies: { shown: false, row: null, chosen: [], file: "mended.toml" },
  labels: null,
  sketch: null,
  placing: false,
  busy: { t: "busy", text: "", share: null, cancel: false, hulls: false, picture: null },
  running: { t: "running", branch: null, branches: [], stopped: "", remaining_s: null },
  scene3d: null,
  written: [],
  toasts: [],
  view: {
    branch: 0,
    k: 0,
    stage: null,
    obj: null,
    arm: null,
    moment: null,
    edited: null,
    doubt: null,
    a: null,
    b: null,
    beside: null,
    grasp: null,
    allowed: null,
    axes: null,
    together: false,
    pixel: null,
    ruler: null,
    measuring: false,
    layers: {},
    scene: {},
    zoom: null,
    model: null,
    scribbles: false,
    largeMap: null,
    tab: null,
    preset: "inspect",
    full: null,
  },
  link: { given: "", opening: null, written: null, lost: null },
  gallery: {
    begun: false, order: "error", only: {}, search: "", selected: new Set(), at: null, tagging: false, leaving: null,
  },
  sequence: { on: false, run: "", scene: null, by: "", from: 0, to: Infinity, lane: 0, brush: null },
  finishing: null,
  replaying: false,
  draft: {},
  hover: null,
  hoverIn: null,
  lastPane: null,
  overlay: null,
  hiddenTones: null,
  theme: "dark",
  sizes: {},
  speed: 8,
  colorBy: "rank",
  hiddenMaps: [],
  filmFolded: false,
  filmOf: null,
};

/**
 * Listeners are called at most once per animation frame, however much has changed.
 * @type {Set<() => void>}
 */
const listeners = new Set();
let scheduled = false;
export function changed() {
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(() => {
    scheduled = false;
    for (const listener of [...listeners]) listener();
  });
}

/**
 * @param {() => void} listener
 * @returns {() => void} ends it
 */
export function listen(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** @param {Partial<State>} patch */
export function update(patch) {
  Object.assign(state, patch);
  changed();
}

/** @param {Partial<View>} patch */
export function setView(patch) {
  state.view = { ...state.view, ...patch };
  changed();
}

/** @type {(a: unknown, b: unknown) => boolean} */
const same = (a, b) =>
  Object.is(a, b) ||
  (Array.isArray(a) && Array.isArray(b) && a.length === b.length && a.every((x, i) => Object.is(x, b[i])));

/**
 * Redraws the calling component when the result of `select` changes: a value, or an array of values.
 * @template const T
 * @param {(s: State) => T} select
 * @returns {T}
 */
export function useStore(select) {
  const [, redraw] = useState(0);
  const chosen = select(state);
  const last = useRef({ select, chosen });
  last.current = { select, chosen };
  // Not useEffect, which ends a frame after the component: `select` would meet a state that it is not made for.
  useLayoutEffect(() => {
    const check = () => {
      const { select, chosen } = last.current;
      if (!same(select(state), chosen)) redraw((n) => n + 1);
    };
    const stop = listen(check);
    check(); // changes since the component was drawn
    return stop;
  }, []);
  return chosen;
}

/**
 * The answering side: the program's server (connection.js), or the page's own file (file.js).
 * @typedef {object} Server
 * @property {(verb: AnyVerb) => boolean} send  returns whether the verb arrived
 * @property {(key: string) => Promise<ArrayBuffer | null>} load  the bytes of a blob; null = they are gone
 * @property {(path: string) => string} address  of a picture
 */
/** @type {Server} */
let server;
/** @type {Record<string, (message: any) => void>} */
const handlers = {};
/**
 * @template {AnyMessage["t"]} T
 * @param {T} t
 * @param {(message: Extract<AnyMessage, { t: T }>) => void} handler
 */
export function on(t, handler) {
  handlers[t] = handler;
}
/** @param {Server} one */
export function answeredBy(one) {
  server = one;
}

/** @param {AnyVerb} verb */
export const send = (verb) => server.send(verb);
/** @param {string} path */
export const addressOf = (path) => server.address(path);

/** @param {AnyMessage} message */
export function receive(message) {
  handlers[message.t]?.(message);
  changed();
}

// Answers of the server to wants, the latest used last.

/**
 * The answer to a want: that of its kind, or why there is none.
 * @template {AnyWant} W
 * @typedef {(W extends { what: "landscape", part: infer P } ? Extract<AnyAnswer, { what: P }>
 *   : Extract<AnyAnswer, { what: W["what"] }>) | GoneAnswer} AnswerTo
 */

const MOST_ANSWERS = 400;
/** @type {Map<string, { id?: string, slot?: string, answer?: AnyAnswer }>} */
const known = new Map(); // by the want as JSON
/** @type {Map<string, string>} */
const asked = new Map(); // slot → the last want as JSON
/** @type {Map<string, string>} */
const waiting = new Map(); // id → the want as JSON: ids are short, poses are not
/** @type {WeakMap<object, string>} */
const keys = new WeakMap(); // the want → as JSON
let wants = 0;

on("answer", ({ id, answer }) => {
  const key = waiting.get(id) ?? id; // for `evaluate`, the id itself
  waiting.delete(id);
  known.set(key, { ...known.get(key), answer });
});

export function forgetAnswers() {
  known.clear();
  asked.clear();
  waiting.clear();
}

/**
 * The answer to a want, or undefined; asked for once. `slot`: of the wants of one slot the server answers the latest.
 * @template {AnyWant} const W
 * @param {W} of
 * @returns {AnswerTo<W> | undefined}
 */
export function want(of, slot = "") {
  const key = keys.get(of) ?? JSON.stringify(of);
  keys.set(of, key);
  let entry = known.get(key);
  if (!entry || (!entry.answer && entry.slot && asked.get(entry.slot) !== key)) {
    entry = { id: entry?.id ?? `want ${++wants}`, slot };
    if (!send({ verb: "want", id: entry.id, slot, of })) return undefined;
    asked.set(slot, key);
    waiting.set(entry.id, key);
  }
  known.delete(key);
  known.set(key, entry); // used last
  if (known.size > MOST_ANSWERS) {
    const [[dropped, { id }]] = known;
    known.delete(dropped);
    if (id != null) waiting.delete(id);
  }
  return /** @type {AnswerTo<W> | undefined} */ (entry.answer);
}

/**
 * An answer that was asked for by the verb `evaluate`, or undefined.
 * @param {string} id
 */
export const answerTo = (id) =>
  /** @type {Extract<AnyAnswer, { what: "grasp" | "gone" }> | undefined} */ (known.get(id)?.answer);

/**
 * @template {AnyWant} const W
 * @param {W | null} of
 * @returns {AnswerTo<W> | undefined}
 */
export function useWant(of, slot = "") {
  return useStore(() => (of ? want(of, slot) : undefined));
}

/**
 * The server no longer has what an answer names: it is asked for again when it is next needed.
 * @param {AnyAnswer} answer
 */
export function forget(answer) {
  for (const [key, entry] of known) if (entry.answer === answer) known.delete(key);
}

// Binary arrays that messages name.

const MOST_BLOBS = 60;
/** @type {Map<string, { buffer: ArrayBuffer | null, isGone: boolean }>} */
const blobs = new Map();
/**
 * The bytes of a blob, or null until they have come.
 * @param {string} key
 */
export function blob(key) {
  let entry = blobs.get(key);
  if (!entry) {
    const loaded = { buffer: null, isGone: false };
    entry = loaded;
    blobs.set(key, entry);
    server.load(key)
      .then((buffer) => {
        Object.assign(loaded, { buffer, isGone: !buffer });
        changed();
      })
      .catch(() => blobs.delete(key));
    for (const oldest of blobs.keys()) if (blobs.size > MOST_BLOBS) blobs.delete(oldest);
  } else {
    blobs.delete(key);
    blobs.set(key, entry);
  }
  return entry.buffer;
}

const TYPES = {
  float32: Float32Array, uint8: Uint8Array, int32: Int32Array, uint16: Uint16Array, int16: Int16Array,
  float64: Float64Array,
};
const NO_VALUE = { uint8: 255, uint16: 65535, int16: 32767 }; // among whole numbers of a step
/** @typedef {Record<string, Float32Array | Uint8Array | Int32Array | Uint16Array | Int16Array | Float64Array>} Arrays */
/** @type {WeakMap<ArrayBuffer, Arrays>} */
const unpacked = new WeakMap(); // buffer → arrays by name, freed with the blob
/**
 * The arrays of an answer by name, or null until they have come.
 * @param {Extract<AnyAnswer, { arrays: unknown }> | GoneAnswer | undefined} answer
 * @returns {Arrays | null}
 */
export function arraysOf(answer) {
  if (!answer || "gone" in answer) return null;
  const buffer = blob(answer.blob);
  if (!buffer) {
    if (blobs.get(answer.blob)?.isGone) forget(answer);
    return null;
  }
  let arrays = unpacked.get(buffer);
  if (!arrays) {
    arrays = {};
    unpacked.set(buffer, arrays);
    for (const [name, type, offset, length, step] of answer.arrays) {
      const values = new TYPES[type](buffer, offset, length);
      arrays[name] = step ? Float32Array.from(values, (x) => (x === NO_VALUE[type] ? NaN : x * step)) : values;
    }
  }
  return arrays;
}
