"""Marks on the timeline: which iterations are worth a look, and in which tone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from msgspec.structs import replace

from verefine_viz.core.records import Event, Iteration
from verefine_viz.page.run_messages import Mark, MarkTone

QUIET = frozenset({"kept_refined", "no_physics"})
"""Happens all the time, or once for a known reason: no mark."""

ONCE = frozenset({"physics_worse"})
"""Stays so for an object that stands on another one, or on a wrong plane: marked where it first happens to an object.

With every iteration marked, nothing is: in a frame whose eraser lies on a box 25 of 75 iterations of RIR were, in the
built-in stack 116 of 225, and the score fell in none of them. Where it does fall, that is a mark of its own.
"""

FALL = 0.01
"""A smaller difference of scores is the noise of a converged pose and gets no mark [score]."""
GROWTH_MM = 3.0
"""An accepted pose whose error grew by more than this although its score did not fall gets a mark [mm]."""


TONES: dict[str, MarkTone] = {
    "kept_simulated": "rejected",
    "flipped": "flip",
    "arm_switched": "switched",
    "new_best": "best",
    "new_best_scene": "best",
    "edited": "edited",
}
"""By kind of event; all others are problems."""
RED: MarkTone = "problem"


def marks_of(iteration: Iteration, error_growth_mm: float | None = None) -> tuple[Mark, ...]:
    """The marks of one iteration; ``error_growth_mm``: by how much ADD(-S) of the accepted pose grew, if known."""
    k, obj = iteration.index, iteration.instance_id
    before, after = iteration.stages[0].score, iteration.accepted_stage.score
    simulated, refined = iteration.stage("simulated"), iteration.stage("refined")
    hardly_better = (
        simulated is not None
        and refined is not None
        and simulated.score is not None
        and refined.score is not None
        and simulated.score.score - refined.score.score < FALL
    )
    hardly_fell = before is not None and after is not None and before.score - after.score < FALL
    marks = [
        Mark(k, obj, e.kind, _text(e), TONES.get(e.kind, RED))
        for e in iteration.events
        if e.kind not in QUIET
        # A tree search looks at the cost of complete scenes, not at this score.
        and not (e.kind == "score_fell" and (hardly_fell or iteration.tree is not None))
        and not (e.kind == "kept_simulated" and hardly_better)
    ]
    score_rose = before is not None and after is not None and after.score >= before.score
    if error_growth_mm is not None and error_growth_mm > GROWTH_MM and score_rose:
        assert before is not None
        assert after is not None
        text = (
            f"The score rose ({before.score:.3f} → {after.score:.3f}) while the error grew by {error_growth_mm:.1f} mm."
        )
        marks.append(Mark(k, obj, "error_grew", text, RED))
    return tuple(marks)


def listed_marks(marked: Sequence[tuple[Iteration, Sequence[Mark]]]) -> tuple[Mark, ...]:
    """The marks of iterations in their order; of those that stay so (:data:`ONCE`) the first of each object, which says
    how often it happens.
    """
    total = Counter(iteration.instance_id for iteration, _ in marked)
    times = Counter((i.instance_id, m.kind) for i, marks in marked for m in marks if m.kind in ONCE)
    thinned: list[Mark] = []
    for iteration, marks in marked:
        for mark in marks:
            # Taken out where it is added, so that there is none left for the next one.
            n = times.pop((iteration.instance_id, mark.kind), 0)
            if mark.kind not in ONCE:
                thinned.append(mark)
            elif n:
                often = (
                    f" So it is in {n} of {total[iteration.instance_id]} iterations of this object." if n > 1 else ""
                )
                thinned.append(replace(mark, text=mark.text + often))
    return tuple(thinned)


def _text(event: Event) -> str:
    """What the page says of an event: the best scene of a cluster is called its incumbent everywhere."""
    if event.kind == "new_best_scene":
        return f"New incumbent{event.text.removeprefix('New best scene')}"
    return event.text


def jumps(marks: Sequence[Mark]) -> tuple[int, ...]:
    """Iterations to stop at when jumping from mark to mark: every mark but a plain new best."""
    return tuple(sorted({m.k for m in marks if m.kind != "new_best"}))
