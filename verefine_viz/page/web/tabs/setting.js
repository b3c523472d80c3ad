// One setting as a field, and the settings that hold in a branch.
import { html } from "../vendor/htm-preact.js";
import { state } from "../store.js";
import { Select, Toggle } from "../ui.js";

// All settings with the values that a branch ends up with.
export function settingsOf(s, index = s.view.branch) {
  const own = s.branches.find((b) => b.index === index)?.settings ?? {};
  return (s.frame?.choices.settings ?? []).map((one) => (one.name in own ? { ...one, value: own[one.name] } : one));
}

// Units are the ends of settings' names.
const UNITS = { m: "m", mm: "mm", deg: "°", s: "s", px: "px", kg: "kg", n: "N", m_s2: "m/s²" };
const UNIT = new RegExp(`_(${Object.keys(UNITS).sort((a, b) => b.length - a.length).join("|")})$`);
export function shortName(name) {
  if (name === "method.name") return "method";
  const last = name.split(".").pop();
  const unit = UNIT.exec(last)?.[1];
  const words = last.replace(UNIT, "").replaceAll("_", " ").replace(/^tau$/, "τ").replace(/^alpha$/, "α");
  return unit ? `${words} [${UNITS[unit]}]` : words;
}
export const shown = (value) => (typeof value === "number" ? String(+value.toPrecision(6)) : String(value));
export const listOf = (changes) => Object.entries(changes).map(([name, v]) => `${shortName(name)} = ${shown(v)}`).join(", ");

// What was typed as the setting's value; undefined where it is none.
export function parsed(setting, text) {
  if (setting.kind !== "int" && setting.kind !== "float") return text;
  const value = text.trim() === "" ? NaN : Number(text);
  return Number.isFinite(value) && (setting.kind === "float" || Number.isInteger(value)) ? value : undefined;
}

// value: as typed; onChange(value) gets texts of numbers as they are typed.
export function Field({ setting, value, onChange }) {
  if (state.file) return html`<span>${shown(value)}</span>`;
  if (setting.kind === "bool") return html`<${Toggle} value=${value} onChange=${onChange}>${value ? "on" : "off"}<//>`;
  if (setting.kind === "choice") return html`<${Select} value=${value} options=${setting.choices} onChange=${onChange} />`;
  const wrong = parsed(setting, String(value)) === undefined;
  return html`<input type="text" class=${`setting ${wrong ? "wrong" : ""}`} value=${typeof value === "number" ? shown(value) : value}
    title=${wrong ? `not ${setting.kind === "int" ? "a whole number" : "a number"}` : setting.kind}
    inputmode=${setting.kind === "text" ? undefined : "decimal"} onInput=${(e) => onChange(e.currentTarget.value)} />`;
}
