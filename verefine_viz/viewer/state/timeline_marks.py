"""Marks on the timeline: which iterations are worth a look, and in which colour."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from verefine_viz.core.palette import EVENT_COLORS, RGB
from verefine_viz.core.records import Event, Iteration

QUIET = frozenset({"kept_refined", "no_physics"})
"""Happens all the time, or once for a known reason: no mark."""

ONCE = frozenset({"physics_worse"})
"""Stays so for an object that stands on another one, or on a wrong plane: marked where it first happens to an object.

With every iteration marked, nothing is: in a frame whose eraser lies on a box 25 of 75 iterations of RIR were, in the
built-in stack 116 of 225, and the score fell in none of them. Where it does fall, that is a mark of its own.
"""

RED = (220, 50, 47)
FALL = 0.01
"""A smaller difference of scores is the noise of a converged pose and gets no mark [score]."""
GROWTH_MM = 3.0
"""An accepted pose whose error grew by more than this although its score did not fall gets a mark [mm]."""


@dataclass(frozen=True)
class Meaning:
    """What the marks of one colour say."""

    words: str
    hint: str
    color: RGB
    kinds: frozenset[str]
    sign: str = "▼"
    """The shape of the marks as a letter."""


MEANINGS: tuple[Meaning, ...] = (
    Meaning(
        "problem",
        "The score fell, the simulated pose scores far less than the pose it began with (marked the first time that it "
        "happens to an object, with how often), the object would tip where the simulation leaves it, a pose rendered "
        "to nothing or its score is not a number, the refiner found nothing to hold on to, the error against ground "
        "truth grew although the score did not fall, or a correct pose was given up for a wrong answer.",
        RED,
        frozenset(
            {
                "score_fell",
                "physics_worse",
                "unstable",
                "empty_render",
                "nan_score",
                "refiner_stuck",
                "error_grew",
                "discarded",
            }
        ),
    ),
    Meaning(
        "rejected",
        "The simulated pose scored clearly higher than the refined one and was accepted.",
        EVENT_COLORS["kept_simulated"],
        frozenset({"kept_simulated"}),
    ),
    Meaning(
        "flip",
        "A flip of the pose scored higher and was accepted: the shape looks nearly the same there, the colours do not.",
        EVENT_COLORS["flipped"],
        frozenset({"flipped"}),
    ),
    Meaning(
        "switched",
        "Another hypothesis was chosen than before.",
        EVENT_COLORS["arm_switched"],
        frozenset({"arm_switched"}),
    ),
    Meaning(
        "new best",
        "No pose of the object scored as high before.",
        EVENT_COLORS["new_best"],
        frozenset({"new_best"}),
        "▾",
    ),
    Meaning(
        "new incumbent",
        "The objects of a cluster never fitted better together.",
        EVENT_COLORS["new_best_scene"],
        frozenset({"new_best_scene"}),
        "◆",
    ),
    Meaning("edited pose", "Its pose was edited before this iteration.", EVENT_COLORS["edited"], frozenset({"edited"})),
)
"""All colours that marks can have."""


@dataclass(frozen=True)
class Mark:
    """One mark."""

    iteration: int
    kind: str
    text: str
    color: RGB

    @property
    def is_red(self) -> bool:
        return self.color == RED


def marks_of(iteration: Iteration, error_growth_mm: float | None = None) -> tuple[Mark, ...]:
    """The marks of one iteration; ``error_growth_mm``: by how much ADD(-S) of the accepted pose grew, if known."""
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
        Mark(iteration.index, e.kind, _text(e), EVENT_COLORS[e.kind])
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
        marks.append(Mark(iteration.index, "error_grew", text, RED))
    return tuple(marks)


def once_per_object(marked: Sequence[tuple[Iteration, Sequence[Mark]]]) -> tuple[Mark, ...]:
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
    return tuple(sorted({m.iteration for m in marks if m.kind != "new_best"}))
