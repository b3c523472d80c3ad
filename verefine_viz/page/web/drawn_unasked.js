// What is drawn beside poses, in the image and in 3D, where it says something, until the user chooses: the poses that the
// image allows, the axes of A and B, and in the image the mask or the support plane that is to blame.
import { setView, state } from "./store.js";

/** @import { AllowedByImage, Pose } from "./messages.d.ts" */
/** @import { Moment } from "./moment.js" */
/** @import { State } from "./store.js" */

const FAR_DEG = 45; // an answer that is turned by more shows how

/** @type {(moment: Moment) => AllowedByImage | null} */
export const allowedOf = (moment) => (moment.isAnswer && moment.verdict?.allowed) || null;
/** @type {(moment: Moment) => [("A" | "B"), Pose][]} */
export const axesOf = ({ a, b, same }) => /** @type {[("A" | "B"), Pose][]} */ ([["A", a?.T], ["B", same ? null : b?.T]]).filter(([, T]) => T);

/** @type {Record<string, (s: State, moment: Moment) => boolean>} */
const IS_SHOWN = {
  allowed: (s, moment) => s.view.allowed ?? Boolean(allowedOf(moment)?.unasked),
  axes: (s, moment) => s.view.axes ?? (moment.isAnswer && moment.verdict?.tone === "wrong" && moment.verdict.deg > FAR_DEG),
};

/** Whether a layer of the image, "mask" or "plane", is the cause of the answer: causes and layers have the names in common.
 * @type {(moment: Moment | null, key: string) => boolean} */
export const isToBlame = (moment, key) => Boolean(moment?.isAnswer && moment.verdict?.findings[0]?.cause === key);

/** @param {string} key  of a layer */
export const isChosenBySense = (key) => key in IS_SHOWN;
/** @type {(s: State, moment: Moment, key: string) => boolean} */
export const isDrawn = (s, moment, key) => IS_SHOWN[key](s, moment);
/** @type {(moment: Moment, key: string) => void} */
export const toggleDrawn = (moment, key) => setView({ [key]: !isDrawn(state, moment, key) });
