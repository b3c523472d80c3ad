// Short messages in a corner: notes that go by themselves, errors that stay.
import { state, update } from "./store.js";

const TOAST_MS = 6000;
let number = 0;
export function toast(kind, text, more = {}) {
  const id = ++number;
  const toasts = [...state.toasts.filter((t) => t.text !== text), { id, kind, text, ...more }].slice(-4);
  update({ toasts });
  if (kind !== "error") setTimeout(() => dismiss(id), TOAST_MS);
  return id;
}
export const dismiss = (id) => update({ toasts: state.toasts.filter((t) => t.id !== id) });
