// The tabs of the inspector in their order. A tab is a module { title, needs(state), empty, render }: `render` is a
// component, drawn where `needs` is true; else `empty` says why not, a text or a function of the state.
import * as score from "./score.js";
import * as errors from "./errors.js";
import * as bandit from "./bandit.js";
import * as physics from "./physics.js";
import * as landscape from "./landscape.js";
import * as compare from "./compare.js";
import * as settings from "./settings.js";
import * as order from "./order.js";
import * as grasp from "./grasp.js";
import * as track from "./track.js";
import * as trace from "./trace.js";
import * as refiner from "./refiner.js";
import * as session from "./session.js";

export const tabs = [score, errors, bandit, physics, landscape, settings, compare, order, grasp, track, trace, refiner,
  session];

export const idOf = (tab) => tab.title.toLowerCase();
