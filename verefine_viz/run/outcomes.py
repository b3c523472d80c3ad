"""Two runs of one frame against each other: which came nearer, and at what cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.run.compare import Trace, name_of, refiner_calls, rollout_calls

ErrorsOf = Callable[[Target, Float], PoseErrors | None]
EVEN_MM = 0.1
"""Answers whose ADD(-S) differ by less are even [mm]."""
EVEN_SCORE = 0.001
"""Without ground truth, answers whose scores differ by less are even [score]."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Where one run has one object."""

    best: Best
    errors: PoseErrors | None
    score: float
    """By the rule of A, so that both can be compared."""


Winner = Literal["A", "B", "even"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """One object in both runs."""

    instance_id: int
    name: str
    a: Answer | None
    """None where that run does not solve it."""
    b: Answer | None
    calls_a: int
    """Refiner calls spent on it."""
    calls_b: int

    @property
    def winner(self) -> Winner | None:
        """Which is nearer to ground truth, or scores higher where none is known; None where one has no answer."""
        if self.a is None or self.b is None:
            return None
        if self.a.errors is not None and self.b.errors is not None:
            gain, even = self.a.errors.add_s_mm - self.b.errors.add_s_mm, EVEN_MM
        else:
            gain, even = self.b.score - self.a.score, EVEN_SCORE
        return "even" if abs(gain) < even else "B" if gain > 0 else "A"


@dataclass(frozen=True)
class Effort:
    """What a run has cost so far."""

    iterations: int
    planned: int
    refiner_calls: int
    rollout_calls: int
    ms: float
    """Computing time of its iterations [ms]."""


def effort_of(trace: Trace) -> Effort:
    """The effort of a run so far."""
    done = trace.iterations
    calls, rollouts = sum(map(refiner_calls, done)), sum(map(rollout_calls, done))
    return Effort(len(done), trace.n_planned, calls, rollouts, sum(i.ms for i in done))


def outcomes(
    a: Trace,
    b: Trace,
    errors_of: ErrorsOf,
    score_of: Callable[[Target, Best], float] | None = None,
) -> tuple[Outcome, ...]:
    """The answers of both runs so far, object by object.

    Args:
        a: one run.
        b: the other.
        errors_of: errors of a pose against ground truth, None where there is none.
        score_of: score of B's answer by the rule of A; None = both score alike, B's own score will do.
    """

    def answer(trace: Trace, own: int, re_score: bool) -> Answer | None:
        best = trace.answers[-1].get(own)
        if best is None:
            return None
        target = trace.problem.target(own)
        score = score_of(target, best) if re_score and score_of is not None else best.score.score
        return Answer(best, errors_of(target, best.T_cam_obj), score)

    def calls(trace: Trace, own: int) -> int:
        return sum(map(refiner_calls, trace.own.get(own, ())))

    ids = dict.fromkeys((*a.instance_ids, *b.instance_ids))
    return tuple(
        Outcome(
            own,
            name_of(a.problem if own in a.instance_ids else b.problem, own),
            answer(a, own, re_score=False),
            answer(b, own, re_score=True),
            calls(a, own),
            calls(b, own),
        )
        for own in ids
    )
