// The answers of a batch: which pass the filters, in which order, which one is open, and the failures around it.
import { listen, send, state, update } from "./store.js";
import { momentOf } from "./moment.js";
import { setPreset } from "./layout.js";
import { limits } from "./palette.js";
import { number } from "./ui.js";

/** @import { AnswersMessage, FrameMessage, GalleryRow } from "./messages.d.ts" */
/** @import { State } from "./store.js" */

export const TONES = {
  wrong: ["cross", "wrong", "--bad"], none: ["cross", "no answer", "--doubt"],
  seen: ["eye", "right as far as the image shows", "--seen"], right: ["check", "right", "--good"],
  doubt: ["warn", "impossible, no ground truth", "--doubt"], unknown: ["question", "no ground truth", "--dim"], waiting: ["dot", "not solved yet", "--faint"],
};

/**
 * @param {GalleryRow} row
 * @param {string} by  tag, or a field that is a text
 */
export const valuesOf = (row, by) => (by === "tag" ? row.tags : by === "object" ? [row.name || "all objects"] : row[by] ? [row[by]] : []);

/** @param {Partial<import("./store.js").GalleryView>} patch */
export const choose = (patch) => update({ gallery: { ...state.gallery, ...patch } });

/**
 * Rows by what is chosen; without one filter for the counts of its own values.
 * @param {GalleryRow} row
 * @param {{ only: Record<string, string[]>, words: string[] }} chosen
 * @param {string} [except]
 */
export function passes(row, { only, words }, except) {
  for (const by in only) {
    if (by !== except && only[by].length && !valuesOf(row, by).some((v) => only[by].includes(v))) return false;
  }
  return words.every((word) => wordsOf(row).includes(word) || row.tags.some((tag) => tag.toLowerCase().includes(word)));
}
const searched = new WeakMap(); // row → what a search looks through
/** @param {GalleryRow} row */
function wordsOf(row) {
  if (!searched.has(row)) {
    const { name, frame, method, run, result, cause, evidence, message } = row;
    searched.set(row, [name, frame, method, run, result, cause, evidence, message].join(" ").toLowerCase());
  }
  return searched.get(row);
}
export const chosenOf = ({ only, search }) => ({ only, words: search.toLowerCase().split(/\s+/).filter(Boolean) });

/** @type {{ rows: GalleryRow[], answers?: AnswersMessage, only?: object, search?: string, order?: string }} */
let shown = { rows: [] }; // cache: the rows, and what they follow from
/**
 * The rows that pass, in order.
 * @param {State} s
 */
export function visible(s) {
  const { answers, gallery } = s;
  if (!answers) return [];
  if (shown.answers === answers && shown.only === gallery.only && shown.search === gallery.search && shown.order === gallery.order) return shown.rows;
  const chosen = chosenOf(gallery);
  const keys = (answers.orders.find((o) => o.id === gallery.order) ?? answers.orders[0]).keys;
  const rows = keys.map((key) => answers.rows[key]).filter((row) => passes(row, chosen));
  shown = { answers, only: gallery.only, search: gallery.search, order: gallery.order, rows };
  return rows;
}

/** @type {{ rows: GalleryRow[], answers?: AnswersMessage, frame?: FrameMessage }} */
let opened = { rows: [] }; // cache: the answers of the open frame
/**
 * The answer that is open, or null.
 * @param {State} s
 */
export function openRow(s) {
  const { frame, answers } = s;
  if (!frame?.run || !answers) return null;
  if (opened.answers !== answers || opened.frame !== frame) {
    const rows = answers.rows.filter((row) => row.run === frame.run && row.frame === frame.frame && row.method === frame.method);
    opened = { answers, frame, rows };
  }
  const obj = momentOf(s)?.obj;
  return opened.rows.find((row) => row.obj === obj) ?? opened.rows[0] ?? null;
}

/** @param {GalleryRow} row */
const isFailure = (row) => row.opens && ["wrong", "none", "doubt"].includes(row.tone);
/** @type {{ rows: GalleryRow[], of?: GalleryRow[] }} */
let failed = { rows: [] }; // cache: of the rows that pass
/** @param {State} s */
export function failures(s) {
  const { answers } = s;
  const of = visible(s);
  if (failed.of !== of) {
    const rows = of.filter(isFailure);
    failed = { of, rows: rows.length || !answers ? rows : answers.orders[0].keys.map((key) => answers.rows[key]).filter(isFailure) };
  }
  return failed.rows;
}
// The failure after (1) or before (−1) the answer that is open, in the gallery's order; null at the ends.
/** @type {(s: State, by: number) => GalleryRow | null} */
export function neighbour(s, by) {
  const rows = failures(s);
  const open = openRow(s);
  const at = rows.findIndex((row) => row.key === open?.key);
  return rows[at < 0 ? (by > 0 ? 0 : rows.length - 1) : at + by] ?? null;
}

/**
 * Opens an answer.
 * @param {GalleryRow | null | undefined} row
 * @param {string} [beside]  a recorded run of its frame, both then side by side at their ends
 */
export function openAnswer(row, beside = "") {
  if (!row?.opens || !send({ verb: "open", answer: row.key, beside })) return;
  choose({ at: row.key, leaving: { frame: state.frame?.id, to: beside ? "compare" : "inspect" } });
}

listen(() => {
  const { answers, gallery } = state;
  if (answers && !gallery.begun) {
    choose({ begun: true, only: Object.fromEntries(Object.entries(answers.first).map(([by, value]) => [by, [value]])) });
    if (!state.link.given && !state.report) setPreset("gallery");
  }
  if (gallery.leaving && state.frame?.id !== gallery.leaving.frame) {
    const { to } = gallery.leaving;
    choose({ leaving: null });
    if (["gallery", "report"].includes(state.view.preset)) setPreset(to);
  }
});

// The error as a share of the diameter.
/** @param {GalleryRow} row */
export const shareOf = (row) => (row.limit && row.err != null ? (limits.correct * row.err) / row.limit : null);

/** @param {GalleryRow} row */
export const errorWords = (row) =>
  row.tone === "waiting" ? "not solved yet"
  : row.status === "failed" ? "frame failed" : row.status === "left_out" ? "left out" : row.status !== "ok" ? "no answer"
  : row.err != null ? [row.limit && `${number(100 * shareOf(row), shareOf(row) < 0.1 ? 1 : 0)} %`, `${number(row.err, 1)} mm`].filter(Boolean).join(" · ")
  : row.undetermined_mm != null ? `± ${number(row.undetermined_mm, 1)} mm, ${number(row.undetermined_deg, 0)}°` : "no ground truth";

// The number beside it on a card: by which the cards are sorted, where that is another one; else the score.
/** @type {(row: GalleryRow, order: string) => string} */
export const besideError = (row, order) =>
  order === "time" ? `${number(row.ms / 1000, 1)} s`
  : order === "undetermined" ? (row.undetermined_deg == null ? "" : `± ${number(row.undetermined_deg, 0)}°`)
  : row.score == null ? "" : number(row.score, 2);
