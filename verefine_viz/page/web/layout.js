// The sizes of panes, remembered per preset and browser; the theme.
import { state, setView, update } from "./store.js";
import { isLabelled } from "./moment.js";

const SIZES = { image: 0.5, inspector: 0.27, maps: 0.32, timeline: 0.26 };
// Words need less of a large window: there pictures get what inspector and timeline leave.
const LARGE_PX = 2200;
const LARGE = { inspector: 0.8, timeline: 0.77 };
export const isLarge = () => innerWidth >= LARGE_PX;
export const PRESETS = [
  { id: "report", title: "Report", hint: "what came out (R)", sizes: SIZES },
  { id: "label", title: "Label", hint: "place models, snap, accept", sizes: { image: 0.58, inspector: 0.27 } },
  { id: "inspect", title: "Inspect", hint: "image, 3D and maps", sizes: SIZES },
  { id: "maps", title: "Maps",
    hint: "large score maps", full: "maps", sizes: { image: 0.5, inspector: 0.27, maps: 0.5, timeline: 0.18 } },
  { id: "compare", title: "Compare", hint: "two runs side by side", tab: "compare",
    sizes: { image: 0.5, inspector: 0.36, maps: 0.34, timeline: 0.24 } },
  { id: "gallery", title: "Gallery", hint: "all answers of a batch",
    sizes: { image: 0.5, inspector: 0.27, maps: 0.32, timeline: 0.24 } },
];
// Those that there is something to show in: a report has no frame until an answer is opened.
export const presets = (s) =>
  PRESETS.filter(({ id }) => (id === "report" ? s.report : id === "label" ? isLabelled(s.frame) : id === "gallery" ? s.answers || !s.file
    : id === "compare" && s.file ? s.compare : s.frame || !s.report));
const LIMITS = { image: [0.12, 0.88], inspector: [0.17, 0.5], maps: [0.12, 0.7], timeline: [0.13, 0.5] };

const KEY = "verefine-layout";
const read = () => {
  try {
    return JSON.parse(localStorage.getItem(KEY)) ?? {};
  } catch {
    return {};
  }
};
const write = (patch) => {
  try {
    localStorage.setItem(KEY, JSON.stringify({ ...read(), ...patch }));
  } catch {
    // Without storage it holds until the page is left.
  }
};

const { sizes = state.sizes, speed = state.speed, colorBy = state.colorBy, hiddenMaps = state.hiddenMaps,
  filmFolded = state.filmFolded } = read();
update({ sizes, speed, colorBy, hiddenMaps, filmFolded });

export function sizesOf(s) {
  const { sizes } = PRESETS.find((p) => p.id === s.view.preset) ?? PRESETS[0];
  const large = Object.entries(LARGE).map(([name, by]) => [name, by * sizes[name]]);
  return { ...sizes, ...(isLarge() ? Object.fromEntries(large) : {}), ...s.sizes[s.view.preset] };
}

export function setSize(name, share) {
  const [least, most] = LIMITS[name];
  const { preset } = state.view;
  const sizes = { ...state.sizes,
    [preset]: { ...state.sizes[preset], [name]: Math.max(least, Math.min(most, share)) } };
  write({ sizes });
  update({ sizes });
}

export function setPreset(id) {
  const preset = PRESETS.find((p) => p.id === id);
  if (state.view.preset === id) {
    // Chosen again: its sizes as they were designed.
    const sizes = { ...state.sizes, [id]: undefined };
    write({ sizes });
    update({ sizes });
  }
  setView({ preset: id, full: preset.full ?? null, ...(preset.tab ? { tab: preset.tab } : {}) });
}

export function remember(patch) {
  write(patch);
  update(patch);
}

const system = matchMedia("(prefers-color-scheme: light)");
export function applyTheme() {
  const theme = read().theme ?? (system.matches ? "light" : "dark");
  document.documentElement.dataset.theme = theme;
  update({ theme });
}
system.addEventListener("change", applyTheme);
export function switchTheme() {
  write({ theme: state.theme === "light" ? "dark" : "light" });
  applyTheme();
}
