// The page as one file: messages, answers and arrays are elements of the document, and there is no program behind it.
import { answeredBy, on, receive, setView, state, update } from "./store.js";
import { toast } from "./toasts.js";

const textOf = (id) => document.getElementById(id)?.textContent ?? null;
export const isFile = textOf("page") != null;

// By what is asked, with sorted names: { answer }; outlines by object and pose.
const answers = new Map();
const outlines = new Map();
const keyOf = (of) => JSON.stringify(Object.entries(of).sort(([a], [b]) => (a < b ? -1 : 1)));
const poseKey = (obj, T) => `${obj} ${T.join()}`;

const MAPS = {
  end: "The file holds the maps of the answer, of ground truth where it is known, and of the iterations that the verdict names.",
  marked: "The file holds the maps of the answer, of ground truth where it is known, of the initial poses and of the marked iterations, switches aside.",
};

/** @param {import("./messages.d.ts").AnyWant} of */
function answer(of) {
  if (of.what === "outlines") return { what: "outlines", outlines: of.poses.map((T) => outlines.get(poseKey(of.obj, T)) ?? []) };
  return answers.get(keyOf(of)) ?? { what: "gone", gone: (of.what === "maps" && MAPS[state.file.maps]) || "The file does not hold this." };
}

const later = (id, of) => queueMicrotask(() => receive({ t: "answer", id, answer: answer(of) }));

function bytes(id) {
  const text = textOf(id);
  if (text == null) return Promise.resolve(null);
  return fetch(`data:application/gzip;base64,${text}`)
    .then((reply) => new Response(reply.body.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
}

// `object=2&iteration=17`, see docs/page.md.
function openLink(link) {
  const named = new URLSearchParams(link);
  const isIt = (o) => (named.has("instance") ? o.id === Number(named.get("instance")) : o.obj_id === Number(named.get("object")));
  const obj = state.frame.objects.find(isIt)?.id ?? null;
  receive({ t: "view", patch: { obj }, at: named.has("iteration") ? Number(named.get("iteration")) : null });
}

const server = {
  send(verb) {
    if (verb.verb === "want") later(verb.id, verb.of);
    else if (verb.link != null) openLink(verb.link);
    else if (verb.verb === "open" && verb.answer != null) openAnswer(state.answers.rows[verb.answer]);
    else if (verb.verb !== "look") toast("note", `This needs the program: ${state.file.command}`);
    return true;
  },
  load: (key) => bytes(`blob ${key}`),
  // Pictures lie in the file as addresses of their own.
  address: (path) => textOf(path.split("?")[0]) ?? path,
};

on("file", (file) => update({ file }));

// The 3D view, a page of its own; null where the file has none.
export const scenePage = () => bytes("scene3d").then((page) => page && new TextDecoder().decode(page));

// Open a part of the document: what a server would send, and answers to what is then asked.
let opened = 0;
async function open(part) {
  const given = JSON.parse(new TextDecoder().decode(await bytes(part)));
  answers.clear(); // they name iterations and objects of the frame that was open
  outlines.clear();
  for (const [of, one] of given.answers) {
    if (of.what === "outlines") of.poses.forEach((T, i) => outlines.set(poseKey(of.obj, T), one.outlines[i]));
    else answers.set(keyOf(of), one);
  }
  opened += 1;
  for (const message of given.messages) receive(message.t === "frame" ? { ...message, id: opened } : message);
}

/**
 * A report holds some frames, each a part of its own; others are files beside it.
 * @param {import("./messages.d.ts").GalleryRow} row
 */
async function openAnswer({ part, file, obj, k, command }) {
  if (part == null && file) return location.assign(`${file.split("/").map(encodeURIComponent).join("/")}#instance=${obj}&iteration=${k}`);
  if (part == null) return toast("note", `The report does not hold this frame. It opens by ${command}`);
  await open(`part ${part}`);
  history.pushState("answer", "");
  return receive({ t: "view", patch: { obj }, at: k });
}
addEventListener("popstate", () => state.report && setView({ preset: "report" }));

export function openFile() {
  answeredBy(server);
  return open("page").then(() => update({ connection: "open" }));
}
