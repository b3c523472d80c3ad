// The doubt about the data that the image shows, and what is drawn of it.
import { setView, state, want } from "./store.js";
import { pathOf } from "./outlines.js";

/** @import { DoubtAnswer, DoubtShape, DoubtShown } from "./messages.d.ts" */
/** @import { State } from "./store.js" */

/** @type {Record<DoubtShape["role"], { color: string, wide: number }>} */
export const LOOKS = { // on pictures, which are dark in both themes; what has no object is filled
  mask: { color: "#ffd23c", wide: 1 },
  edges: { color: "#4cc9f0", wide: 1 },
  given: { color: "#ff5cc8", wide: 2.2 },
  fits: { color: "#45c779", wide: 1.8 },
};

/** @type {(s: State) => DoubtShown[]} */
const doubtsOf = (s) => [...(s.verdicts.get(s.view.branch)?.doubts ?? s.frame?.doubts ?? [])];

/** @type {(s: State) => DoubtShown | null} */
export const shownDoubt = (s) => (s.view.doubt == null ? null : doubtsOf(s)[s.view.doubt] ?? null);

export const closeDoubt = () => setView({ doubt: null, zoom: null, full: null });

/** @type {() => DoubtAnswer | null} */
export function pictureOf() {
  if (!shownDoubt(state)) return null;
  const answer = want({ what: "doubt", index: state.view.doubt, branch: state.view.branch }, "doubt");
  return answer && "shapes" in answer ? answer : null;
}

/** @type {WeakMap<DoubtAnswer, { path: Path2D, filled: boolean, color: string, wide: number }[]>} */
const paths = new WeakMap(); // cache: of each answer
// What the image pane outlines instead of the poses of the moment.
export function contoursOfDoubt() {
  const answer = pictureOf();
  if (!answer) return [];
  if (!paths.has(answer)) {
    paths.set(answer, answer.shapes.map((one) => (
      { path: pathOf(one.polygons.map((p) => [...p])), filled: one.obj == null, ...LOOKS[one.role] })));
  }
  return paths.get(answer);
}
