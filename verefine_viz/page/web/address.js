// The page's address says what is shown, as `#frame=0/0&object=2&iteration=17`; one that is typed or pasted is opened.
import { listen, send, state } from "./store.js";
import { runOf } from "./moment.js";
import { toast } from "./toasts.js";

function hashLink() {
  try {
    return decodeURI(location.hash.slice(1));
  } catch {
    return ""; // no link that anybody wrote
  }
}

/** @param {import("./store.js").State} s */
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
  // A branch holds what was edited here; the first run is what a link opens anyway.
  if (s.branches.length && s.view.branch !== s.branches[0].index) parts.push(`branch=${s.view.branch}`);
  if (s.frame.run) parts.push(`run=${encodeURIComponent(s.frame.run)}`);
  return parts.join("&");
}

export function copyLink() {
  const link = `${location.href.split("#")[0]}#${linkOf(state)}`;
  const shown = () => toast("note", link);
  navigator.clipboard?.writeText(link).then(() => toast("note", "The link is in the clipboard."), shown) ?? shown();
}

const EVERY_MS = 200; // browsers limit how often an address may change
let timer = null;
function writeAddress() {
  timer = null;
  const link = linkOf(state);
  if (!link || link === state.link.written || state.link.opening) return;
  state.link.written = link;
  history.replaceState(null, "", `#${link}`);
}

function openLink(link) {
  if (send({ verb: "open", link })) state.link.opening = null;
}

// Opens what the page was called with once there is something to open it in, and follows from then on.
export function followAddress() {
  const link = hashLink();
  Object.assign(state.link, { given: link, opening: link || null });
  listen(() => {
    if (state.link.opening && state.connection === "open" && state.frame) openLink(state.link.opening);
    timer ??= setTimeout(writeAddress, EVERY_MS);
  });
  addEventListener("hashchange", () => {
    const link = hashLink();
    if (link && link !== state.link.written) openLink(link);
  });
}
