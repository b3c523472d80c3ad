// Answers that stay in sight while the next one is on its way.
import { useRef } from "../vendor/htm-preact.js";
import { useWant } from "../store.js";

// The server's answer, or the last one for the same `key`; `gone`: why there is none.
export function useKept(of, slot, key) {
  const answer = useWant(of, slot);
  const kept = useRef({});
  if (answer) kept.current = { key, answer };
  return kept.current.key === key ? kept.current.answer : undefined;
}
