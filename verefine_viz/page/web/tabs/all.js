// The tabs of the inspector in their order. A tab is a module { title, needs(state), empty, render }: `render` is a
// component, drawn where `needs` is true; else `empty` says why not, a text or a function of the state.
import * as score from "./score.js";
import * as errors from "./errors.js";

export const tabs = [score, errors];

export const idOf = (tab) => tab.title.toLowerCase();
