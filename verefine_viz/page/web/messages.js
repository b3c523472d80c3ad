// What the server's messages change, what it gets in return, and the page's address.
import { state, setView, update, send, on, listen, forgetAnswers } from "./store.js";
import { toast } from "./toasts.js";
import { followed, goTo, momentOf, runOf, stopReplay } from "./moment.js";

Object.assign(state, { replaying: null });

let written = null; // the link that the address holds
let lost = null; // what was looked at when the connection was lost
let opening = hashLink() || null; // a link that is yet to be opened: it must not be overwritten

on("hello", ({ window, version }) => {
  if (state.version && state.version !== version) location.reload(); // the program was started again, and is another one
  lost = state.connection === "lost" ? written : null;
  update({ connection: "opening", window, version });
});

// All that the server knows has come.
on("ready", () => update({ connection: "open" }));

on("frame", (message) => {
  const isAgain = state.frame?.id === message.id; // after the connection was lost
  forgetAnswers();
  stopReplay();
  state.runs.clear();
  state.verdicts.clear();
  update({ frame: message, compare: null, replaying: null });
  if (!isAgain) {
    opening ??= lost;
    setView({ branch: 0, k: 0, stage: null, obj: null, arm: null, moment: null, edited: null, a: null, b: null,
      pixel: null, ...(message.method === "trace" && state.view.tab === "score" ? { tab: "trace" } : {}) });
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
  if (lost && branch === 0 && rows.length < state.view.k) opening ??= lost;
  lost = null;
  state.runs.set(branch, {
    rows, total: message.total, over: message.over, marks: message.marks, notes: message.notes, missing: message.missing,
    start: message.start ?? (from > 0 ? before?.start : null) ?? null,
  });
  followed(wasAtEnd, branch);
});

on("verdict", (message) => state.verdicts.set(message.branch, message));
on("breakpoints", ({ breakpoints }) => state.frame && update({ frame: Object.assign(state.frame, { breakpoints }) }));
on("busy", (message) => update({ busy: message }));
on("running", (message) => update({ running: message }));
on("note", ({ text }) => toast("note", text));
on("error", ({ text, offer }) => toast("error", text, { offer }));
on("written", (file) => {
  if (file.name.endsWith(".html")) Object.assign(document.createElement("a"), { href: file.url, download: file.name }).click();
  update({ written: [...state.written.filter((f) => f.path !== file.path), file] });
  toast("note", `Written: ${file.path ?? file.name}`, { url: file.url, name: file.name });
});
on("edited", ({ obj, T }) =>
  setView({ edited: { ...(state.view.edited ?? { arm: momentOf(state)?.arm ?? 0 }), obj, T } }));
on("picked", ({ u, v }) => setView({ pixel: [u, v] }));
on("scene3d", ({ window }) => update({ scene3d: window }));
on("answers", (message) => {
  const grown = message.frames && state.frame ? { frame: { ...state.frame, frames: message.frames } } : {};
  update({ answers: message, ...grown });
});
// at: the iteration that a link names, which may be yet to come; null = it names none, so the end is shown.
on("view", ({ patch, at }) => {
  const { k, ...rest } = patch;
  setView(rest);
  if (at !== undefined) goTo(at ?? runOf(state).rows.length);
  else if (k != null) setView({ k: Math.min(k, runOf(state).rows.length), stage: null, moment: null });
});

// The server, and with it the 3D view, gets what this window looks at: at most every 40 ms, the latest wins.

// What this window looks at, as a verb; null while there is nothing.
export function lookOf(s) {
  const { view } = s;
  const moment = momentOf(s);
  if (!moment) return null;
  const beside = moment.beside ? { branch: moment.beside.branch, k: moment.beside.k } : null;
  return {
    verb: "look", branch: view.branch, k: moment.k, stage: view.stage, obj: moment.obj, arm: moment.arm,
    moment: view.moment, edited: view.edited?.T ?? null, grasp: view.grasp ?? null, b: beside, answer: moment.isAnswer,
  };
}

let lastLook = "";
let waiting = null;
function tellLook() {
  waiting = null;
  const verb = state.connection === "open" ? lookOf(state) : null;
  const text = JSON.stringify(verb);
  if (verb && text !== lastLook && send(verb)) lastLook = text;
}
listen(() => {
  waiting ??= setTimeout(tellLook, 40);
});

// The address: frame, object and iteration, as `frame=0/0&object=2&iteration=17`.

function hashLink() {
  try {
    return decodeURI(location.hash.slice(1));
  } catch {
    return ""; // no link that anybody wrote
  }
}

export function linkOf(s) {
  if (!s.frame || s.report) return ""; // a report begins with its numbers
  const parts = [];
  if (s.frame.frame) parts.push(`frame=${s.frame.frame}`);
  const object = s.frame.objects.find((o) => o.id === s.view.obj);
  if (object) {
    const single = s.frame.objects.filter((o) => o.obj_id === object.obj_id).length === 1;
    parts.push(single ? `object=${object.obj_id}` : `instance=${object.id}`);
  }
  // The server computes the run that a link names an iteration of: before the first there is none to name.
  const k = Math.min(s.view.k, runOf(s).rows.length);
  if (k > 0 || runOf(s).over) parts.push(`iteration=${k}`);
  if (s.frame.run) parts.push(`run=${encodeURIComponent(s.frame.run)}`);
  return parts.join("&");
}

export function copyLink() {
  const link = `${location.href.split("#")[0]}#${linkOf(state)}`;
  const shown = () => toast("note", link);
  navigator.clipboard?.writeText(link).then(() => toast("note", "The link is in the clipboard."), shown) ?? shown();
}

let addressWaits = null;
function writeAddress() {
  addressWaits = null;
  const link = linkOf(state);
  if (!link || link === written || opening) return;
  written = link;
  history.replaceState(null, "", `#${link}`);
}

export function openLink(link) {
  if (send({ verb: "open", link })) opening = null;
}

export function start() {
  listen(() => {
    if (opening && state.connection === "open" && state.frame) openLink(opening);
    addressWaits ??= setTimeout(writeAddress, 200); // browsers limit how often an address may change
  });
  addEventListener("hashchange", () => {
    const link = hashLink();
    if (link && link !== written) openLink(link);
  });
}
