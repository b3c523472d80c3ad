// One setting as a field, and the settings that hold in a branch.
import { html } from "htm/preact";
import { state } from "../store.js";
import { Select, Toggle } from "../ui.js";

/** @import { EditableSetting } from "../messages.d.ts" */
/** @import { State } from "../store.js" */

/**
 * All settings with the values that a branch ends up with.
 * @param {State} s
 * @param {number} index
 * @returns {EditableSetting[]}
 */
export function settingsOf(s, index = s.view.branch) {
  const own = s.branches.find((b) => b.index === index)?.settings ?? {};
  return (s.frame?.choices.settings ?? []).map((one) => (one.name in own ? { ...one, value: /** @type {EditableSetting["value"]} */ (own[one.name]) } : one));
}

// Units are the ends of settings' names.
const UNITS = { m: "m", mm: "mm", deg: "°", s: "s", px: "px", kg: "kg", n: "N", m_s2: "m/s²" };
const UNIT = new RegExp(`_(${Object.keys(UNITS).sort((a, b) => b.length - a.length).join("|")})$`);
const NAMES = { "method.name": "method", "method.iterations": "iterations per hypothesis" };
export function shortName(name) {
  if (name in NAMES) return NAMES[name];
  const last = name.split(".").pop();
  const unit = UNIT.exec(last)?.[1];
  const words = last.replace(UNIT, "").replaceAll("_", " ").replace(/^tau$/, "τ").replace(/^alpha$/, "α");
  return unit ? `${words} [${UNITS[unit]}]` : words;
}
const SECTIONS = { icp: "ICP", tricp: "trimmed ICP", densefusion: "DenseFusion", mcts: "tree search", dependency: "order of objects", hypotheses: "initial poses" };
export function sectionOf(name) {
  const section = name.split(".")[0];
  return SECTIONS[section] ?? section.replaceAll("_", " ");
}
/** With its section; one that has none, such as the preset, is its own. */
export const longName = (name) => (name.includes(".") && shortName(name) !== sectionOf(name) ? `${sectionOf(name)}: ${shortName(name)}` : shortName(name));
export const shown = (value) => (typeof value === "number" ? String(+value.toPrecision(6)) : String(value));
export const listOf = (changes) => Object.entries(changes).map(([name, v]) => `${shortName(name)} = ${shown(v)}`).join(", ");

/**
 * What was typed as the setting's value; undefined where it is none.
 * @param {EditableSetting} setting
 * @param {string} text
 */
export function parsed(setting, text) {
  if (setting.kind !== "int" && setting.kind !== "float") return text;
  const value = text.trim() === "" ? NaN : Number(text);
  return Number.isFinite(value) && (setting.kind === "float" || Number.isInteger(value)) ? value : undefined;
}

/**
 * value: as typed; onChange(value) gets texts of numbers as they are typed.
 * @param {{ setting: EditableSetting, value: any, onChange: (value: any) => void }} props
 */
export function Field({ setting, value, onChange }) {
  if (state.file) return html`<span>${shown(value)}</span>`;
  if (setting.kind === "bool") return html`<${Toggle} value=${value} onChange=${onChange}>${value ? "on" : "off"}<//>`;
  if (setting.kind === "choice") return html`<${Select} value=${value} options=${setting.choices} onChange=${onChange} />`;
  const wrong = parsed(setting, String(value)) === undefined;
  return html`<input type="text" class=${`setting ${wrong ? "wrong" : ""}`} value=${typeof value === "number" ? shown(value) : value}
    title=${wrong ? `not ${setting.kind === "int" ? "a whole number" : "a number"}` : setting.kind}
    inputmode=${setting.kind === "text" ? undefined : "decimal"} onInput=${(e) => onChange(e.currentTarget.value)} />`;
}
