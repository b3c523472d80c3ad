// Marked pixels, the same in pictures and in 3D: one gives a point, its normal and its residual; two give a distance.
import { html } from "htm/preact";
import { state, setView, useStore, useWant } from "./store.js";
import { momentOf } from "./moment.js";
import { rulerText } from "./drawing.js";
import { number } from "./ui.js";

/** @param {[number, number]} pixel */
export function mark(pixel) {
  const { measuring, pixel: before, ruler } = state.view;
  const isAgain = String(pixel) === String(before);
  if (measuring && before && !ruler && !isAgain) setView({ ruler: [before, pixel] });
  else setView({ ruler: null, pixel: isAgain ? null : pixel });
}
export const toggleMeasuring = () => setView({ measuring: !state.view.measuring, ruler: null });

/** @type {(s: import("./store.js").State) => import("./messages.d.ts").PointWanted | null} */
function pointOf(s) {
  const moment = momentOf(s);
  if (!moment || !s.view.pixel || s.file) return null;
  const stands = moment.scene.filter((o) => o.T).map((o) =>
    /** @type {import("./messages.d.ts").Standing} */ ([o.object.id, o.T, false]));
  return { what: "point", branch: moment.branch, pixel: s.view.pixel, stands };
}

const numbers = (values, digits) => values.map((x) => number(x, digits).replace("-", "−")).join(", ");

// Point, normal and residual of the marked pixel, and the distance to the second one.
export function Marked() {
  const [of, ruler, measuring] = useStore((s) => [JSON.stringify(pointOf(s)), s.view.ruler, s.view.measuring]);
  const answer = useWant(/** @type {import("./messages.d.ts").PointWanted | null} */ (JSON.parse(of)), "point");
  if (!answer || "gone" in answer) {
    return measuring && html`<div class="marked"><span>Click a point; a second one gives the distance.</span></div>`;
  }
  const { point_mm: point, normal, residual_mm: residual, obj } = answer;
  const label = state.frame.objects.find((o) => o.id === obj)?.label;
  return html`<div class="marked">
    ${ruler && html`<span>distance <b>${rulerText(ruler)}</b></span>`}
    <span>point <b>${point ? `${numbers(point, 1)} mm` : "not measured"}</b></span>
    ${normal && html`<span>normal <b>${numbers(normal, 2)}</b></span>`}
    ${residual != null && html`<span title=${`distance to the surface of ${label} where it stands`}>${
      residual < 0 ? "inside" : "outside"} ${label} <b>${number(Math.abs(residual), 1)} mm</b></span>`}
  </div>`;
}
