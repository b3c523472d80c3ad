// Answers that stay in sight while the next one is on its way.
import { useRef } from "../vendor/htm-preact.js";
import { useWant } from "../store.js";

// The server's answer, or the last one for the same `key`; `gone`: why there is none.
export function useLatest(of, slot, key) {
  const answer = useWant(of, slot);
  const last = useRef({});
  if (answer) last.current = { key, answer };
  return last.current.key === key ? last.current.answer : undefined;
}
