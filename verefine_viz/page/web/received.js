// What messages of the server change in the store, and what it gets in return: where this window looks.
import { state, setView, update, send, on, listen, forgetAnswers } from "./store.js";
import { lookAt } from "./wants.js";
import { learn } from "./palette.js";
import { toast } from "./toasts.js";
import { isLabelled, momentOf, runOf } from "./moment.js";
import { mark } from "./marking.js";
import { moved } from "./edit_history.js";
import { closeDoubt } from "./doubts.js";
import { followed, goTo, stopReplay } from "./cursor.js";

on("hello", (hello) => {
  const { window, version } = hello;
  learn(hello);
  if (state.version && state.version !== version) location.reload(); // the program was started again, and is another one
  state.link.lost = state.connection === "lost" ? state.link.written : null;
  update({ connection: "opening", window, version });
});

// All that the server knows has come.
on("ready", () => update({ connection: "open" }));

on("frame", (message) => {
  const isAgain = state.frame?.id === message.id; // after the connection was lost
  if (isLabelled(message) !== isLabelled(state.frame)) {
    const [preset, zoom] = isLabelled(message) ? ["label", /** @type {const} */ ("image")] : ["inspect", null];
    setView({ preset, zoom, full: null, model: null });
  }
  forgetAnswers();
  stopReplay();
  state.runs.clear();
  state.verdicts.clear();
  update({ frame: message, compare: null });
  if (!isAgain) {
    state.link.opening ??= state.link.lost;
    update({ draft: {} });
    if (state.view.doubt != null) closeDoubt();
    setView({ branch: 0, k: 0, stage: null, obj: null, arm: null, moment: null, edited: null, a: null, b: null,
      pixel: null, ruler: null, allowed: null, axes: null });
  }
  document.title = `${message.title} · verefine-viz`;
});

on("branches", ({ list, compare }) => {
  update({ branches: list, compare });
  for (const branch of state.runs.keys()) if (!list.some((b) => b.index === branch)) state.runs.delete(branch);
  if (list.length && !list.some((b) => b.index === state.view.branch)) setView({ branch: list[0].index, k: Infinity });
});

on("run", (message) => {
  const { branch, from } = message;
  const before = state.runs.get(branch);
  const wasAtEnd = branch === state.view.branch && state.view.k >= (before?.rows.length ?? 0);
  // The rows are one array that grows; the run is another object each time, so that what depends on it is worked out.
  const rows = from > 0 && before ? before.rows : [];
  rows.length = Math.min(rows.length, from);
  for (const row of message.rows) rows.push(row);
  // The program was started again, and has computed less than was shown.
  if (state.link.lost && branch === 0 && rows.length < state.view.k) state.link.opening ??= state.link.lost;
  state.link.lost = null;
  state.runs.set(branch, {
    rows, total: message.total, over: message.over, marks: message.marks, notes: message.notes, missing: message.missing,
    start: message.start ?? (from > 0 ? before?.start : null) ?? null,
  });
  followed(wasAtEnd, branch);
});

on("labels", (message) => {
  const before = state.labels?.frame === message.frame ? state.labels.labels.length : 0;
  update({ labels: message, placing: false });
  if (message.labels.length > before) setView({ model: null }); // it was placed
});
on("verdict", (message) => state.verdicts.set(message.branch, message));
on("doubts", ({ doubts }) => state.frame && update({ frame: { ...state.frame, doubts } }));
on("breakpoints", ({ breakpoints }) => state.frame && update({ frame: Object.assign(state.frame, { breakpoints }) }));
on("busy", (message) => update({ busy: message, placing: state.placing && Boolean(message.text) }));
on("running", (message) => update({ running: message }));
on("note", ({ text }) => toast("note", text));
on("error", ({ text, offer }) => {
  update({ placing: false });
  toast("error", text, { offer });
});
on("written", (file) => {
  if (!file.path) Object.assign(document.createElement("a"), { href: file.url, download: file.name }).click();
  update({ written: [...state.written.filter((f) => f.url !== file.url), file] });
  const words = file.path ? `Written: ${file.path}` : `${file.name} is downloaded.`;
  toast("note", words, { url: file.url, name: file.name });
});
on("edited", ({ obj, T }) =>
  setView({ edited: moved(state.view.edited ?? { arm: momentOf(state)?.arm ?? 0, obj, T }, T, "gizmo") }));
on("picked", ({ u, v }) => mark([u, v]));
on("scene3d", ({ window }) => update({ scene3d: window }));
on("answers", (message) => {
  const grown = message.frames && state.frame ? { frame: { ...state.frame, frames: message.frames } } : {};
  update({ answers: message, ...grown });
});
on("fix", (message) => update({ fix: message }));
// at: the iteration that a link names, which may be yet to come; null = it names none, so the end is shown.
on("view", ({ patch, at }) => {
  const { k, ...rest } = patch;
  setView(rest);
  if (at !== undefined) goTo(at ?? runOf(state).rows.length);
  else if (k != null) setView({ k: Math.min(k, runOf(state).rows.length), stage: null, moment: null });
});

// The server, and with it the 3D view, gets what this window looks at: at most every 40 ms, the latest wins.

let lastLook = ""; // what was sent, of which frame and window: two frames without objects are looked at alike
let timer = null;
function tellLook() {
  timer = null;
  const verb = state.connection === "open" ? lookAt(state, momentOf(state)) : null;
  const text = JSON.stringify([state.window, state.frame?.id, verb]);
  if (verb && text !== lastLook && send(verb)) lastLook = text;
}
listen(() => {
  timer ??= setTimeout(tellLook, 40);
});
