// Answers that stay in sight while the next one is on its way.
import { useRef } from "preact/hooks";
import { useWant } from "../store.js";

/**
 * The server's answer, or the last one for the same `key`; `gone`: why there is none.
 * @template {import("../messages.d.ts").AnyWant} const W
 * @param {W | null} of
 * @param {string} slot
 * @param {string} key
 * @returns {import("../store.js").AnswerTo<W> | undefined}
 */
export function useLatest(of, slot, key) {
  const answer = useWant(of, slot);
  const last = useRef({ key, answer });
  if (answer) last.current = { key, answer };
  return last.current.key === key ? last.current.answer : undefined;
}
