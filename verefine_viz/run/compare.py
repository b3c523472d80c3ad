"""Two runs of one frame, A and B: pairs of iterations, the first differences, and which came nearer at what cost.

Runs differ in length and in the order in which they take the objects. What is compared is the n-th iteration on one
object in A with the n-th on it in B; where both take the objects in one order, that is iteration k with iteration k.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.records import Best, Iteration
from verefine_viz.run.engine import Run


class Pair(NamedTuple):
    """The n-th iteration on one object in both runs."""

    instance_id: int
    n: int
    """1, 2, … on this object."""
    a: int | None
    """Index of A's iteration; None where A has no such."""
    b: int | None


def aligned(a: Sequence[Iteration], b: Sequence[Iteration]) -> tuple[Pair, ...]:
    """All iterations of two runs in pairs, in the order of A; what only B has follows A's last one on that object."""
    of_a, of_b = _numbered(a), _numbered(b)
    last = {i.instance_id: i.index for i in a}
    pairs = [Pair(*key, of_a.get(key), of_b.get(key)) for key in of_a | of_b]
    return tuple(sorted(pairs, key=lambda p: (p.a or last.get(p.instance_id, len(a) + 1), p.a is None, p.b or 0)))


def _numbered(iterations: Sequence[Iteration]) -> dict[tuple[int, int], int]:
    """The index of each iteration, by its object and its number on that object."""
    counted: Counter[int] = Counter()
    numbered: dict[tuple[int, int], int] = {}
    for i in iterations:
        counted[i.instance_id] += 1
        numbered[i.instance_id, counted[i.instance_id]] = i.index
    return numbered


# Where two runs differ, in sentences about what B does otherwise.

Kind = Literal["start", "missing", "hypothesis", "placed", "stages", "pose", "accepted", "score", "answer"]


@dataclass(frozen=True)
class Departure:
    """One thing that B does otherwise than A."""

    place: int
    """Number of the pair, from 1; 0 = before iteration 1."""
    kind: Kind
    text: str
    """What B does, after "B": "works on hypothesis 2 instead of 1"."""
    a: int | None = None
    """Index of A's iteration."""
    b: int | None = None


class Departures(NamedTuple):
    """The first differences of two runs; None where both did the same, bit for bit."""

    deed: Departure | None
    """First thing that is done otherwise: other object, hypothesis, pose, or accepted stage."""
    score: Departure | None
    """First score that differs although the pose is the same."""


def departures(a: Run, b: Run, pairs: Sequence[Pair]) -> Departures:
    """The first differences of two runs.

    An iteration that only one of them has so far counts when the other is done with its run.
    """
    deed = score = None
    for departure in _differences(a, b, pairs):
        if departure.kind == "score":
            score = score or departure
        else:
            deed = deed or departure
        if deed and (score or departure.place > deed.place):
            break
    return Departures(deed, score)


def _differences(a: Run, b: Run, pairs: Sequence[Pair]) -> Iterator[Departure]:
    """Every difference, in the order of the pairs; in a pair what is done before what it scores."""
    ours, theirs = a.iterations, b.iterations
    for kind, text in _starts(a, b):
        yield Departure(0, kind, text)
    for place, pair in enumerate(pairs, 1):
        one = ours[pair.a - 1] if pair.a else None
        other = theirs[pair.b - 1] if pair.b else None
        name = name_of(a.problem if one else b.problem, pair.instance_id)
        for kind, text in (
            _iteration_differences(one, other, name) if one and other else _extra_iteration(a, b, pair, name)
        ):
            yield Departure(place, kind, text, pair.a, pair.b)


def _starts(a: Run, b: Run) -> Iterator[tuple[Kind, str]]:
    """What differs before the first iteration."""
    scores_a, scores_b = _initial_scores(a), _initial_scores(b)
    for own in sorted(scores_a | scores_b):
        name = name_of(a.problem if own in scores_a else b.problem, own)
        if own not in scores_a or own not in scores_b:
            yield "start", f"{'does not solve' if own in scores_a else 'also solves'} {name}"
            continue
        ours, theirs = ([h.T_cam_obj for h in run.problem.target(own).instance.hypotheses] for run in (a, b))
        if len(ours) != len(theirs):
            yield "start", f"has {_n(len(theirs), 'hypothesis', 'hypotheses')} of {name}, A has {len(ours)}"
            continue
        for j, (T_a, T_b) in enumerate(zip(ours, theirs, strict=True), 1):
            if not _same_pose(T_a, T_b):
                yield "start", f"starts hypothesis {j} of {name} {apart(T_a, T_b)} away"
        for j, (f_a, f_b) in enumerate(zip(scores_a[own], scores_b[own], strict=False)):
            if f_a != f_b and _same_pose(ours[j], theirs[j]):
                yield "score", f"scores the initial pose of {name}'s hypothesis {j + 1} {instead(f_b, f_a)}"


def _initial_scores(run: Run) -> dict[int, list[float]]:
    """The scores of the hypotheses before iteration 1, by instance_id; none where the pool is empty."""
    ids = [i.instance_id for i in run.problem.instances]
    pools = run.state_at(0).initial
    return {i: scores.score.tolist() if scores is not None else [] for i, scores in zip(ids, pools, strict=True)}


def _extra_iteration(a: Run, b: Run, pair: Pair, name: str) -> Iterator[tuple[Kind, str]]:
    """An iteration that the other run does not make, where that one is over."""
    done = _n(pair.n - 1, "iteration", "iterations")
    if pair.b is None and b.is_done:
        yield "missing", f"is done with {name} after {done}, while A goes on"
    if pair.a is None and a.is_done:
        yield "missing", f"goes on with {name}, which A is done with after {done}"


def _iteration_differences(one: Iteration, other: Iteration, name: str) -> Iterator[tuple[Kind, str]]:
    yield from _deeds(one, other, name)
    for text in _scores(one, other, name):
        yield "score", text
    T_a, T_b = one.best.T_cam_obj, other.best.T_cam_obj
    if not _same_pose(T_a, T_b):
        yield "answer", f"has its best pose of {name} {apart(T_a, T_b)} away"


def _deeds(one: Iteration, other: Iteration, name: str) -> Iterator[tuple[Kind, str]]:
    if one.arm != other.arm:
        yield "hypothesis", f"works on hypothesis {other.arm + 1} of {name} instead of {one.arm + 1}"
    ours, theirs = [p.instance_id for p in one.placed], [p.instance_id for p in other.placed]
    if ours != theirs:
        yield "placed", f"has {_n(len(theirs), 'object', 'objects')} placed beside {name}, A has {len(ours)}"
    for p, q in zip(one.placed, other.placed, strict=False):
        if p.instance_id == q.instance_id and not _same_pose(p.T_cam_obj, q.T_cam_obj):
            yield "placed", f"has a neighbour of {name} placed {apart(p.T_cam_obj, q.T_cam_obj)} away"
            break
    names_a, names_b = [s.name for s in one.stages], [s.name for s in other.stages]
    if names_a != names_b:
        yield "stages", f"goes through {', '.join(names_b)} with {name} instead of {', '.join(names_a)}"
    for stage in other.stages:
        ours_of = one.stage(stage.name)
        if ours_of is not None and not _same_pose(ours_of.T_cam_obj, stage.T_cam_obj):
            yield "pose", f"has its {stage.name} pose of {name} {apart(ours_of.T_cam_obj, stage.T_cam_obj)} away"
    if one.accepted != other.accepted:
        yield "accepted", f"accepts the {other.accepted} pose of {name} instead of the {one.accepted} one"


def _scores(one: Iteration, other: Iteration, name: str) -> Iterator[str]:
    for stage in other.stages:
        ours = one.stage(stage.name)
        if ours is None or not _same_pose(ours.T_cam_obj, stage.T_cam_obj):
            continue
        f_a = ours.score.score if ours.score else None
        f_b = stage.score.score if stage.score else None
        if f_a != f_b:
            yield f"scores the {stage.name} pose of {name} {instead(f_b, f_a)}"


def _same_pose(T_a: Float, T_b: Float) -> bool:
    """Whether two poses are the same, bit for bit."""
    return np.array_equal(T_a, T_b)


def apart(T_a: Float, T_b: Float) -> str:
    """How far two poses are from each other, as "3.2 mm and 1.1°"."""
    distance_mm = 1e3 * float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]))
    turn_deg = float(np.rad2deg(angle_between(T_a[:3, :3], T_b[:3, :3])))
    if distance_mm < 5e-4 and turn_deg < 5e-4:
        return "less than 0.001 mm and 0.001°"
    digits = 1 if max(distance_mm, turn_deg) >= 0.1 else 3
    return f"{distance_mm:.{digits}f} mm and {turn_deg:.{digits}f}°"


def instead(f_b: float | None, f_a: float | None) -> str:
    """Two scores, with as many digits as it takes to distinguish them: "0.712 instead of 0.705"."""
    if f_a is None or f_b is None:
        return "that A does not score" if f_a is None else "not at all"
    digits = next((d for d in range(3, 16) if f"{f_a:.{d}f}" != f"{f_b:.{d}f}"), 16)
    return f"{f_b:.{digits}f} instead of {f_a:.{digits}f}"


def name_of(problem: Problem, instance_id: int) -> str:
    """An object as shown to the user: its model's name, with its number where there are several of them."""
    target = problem.target(instance_id)
    twins = sum(i.obj_id == target.instance.obj_id for i in problem.instances)
    return f"{target.model.name} #{instance_id}" if twins > 1 else target.model.name


def _n(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"


# Which came nearer, and at what cost.

ErrorsOf = Callable[[Target, Float], PoseErrors | None]
EVEN_MM = 0.1
"""Answers whose ADD(-S) differ by less are even [mm]."""
EVEN_SCORE = 0.001
"""Without ground truth, answers whose scores differ by less are even [score]."""


@dataclass(frozen=True, eq=False)
class ScoredBest:
    """The best pose of one object in one run so far."""

    best: Best
    errors: PoseErrors | None
    score: float
    """By the rule of A, so that both can be compared."""


Winner = Literal["A", "B", "even"]


@dataclass(frozen=True, eq=False)
class ComparedObject:
    """One object in both runs."""

    instance_id: int
    name: str
    a: ScoredBest | None
    """None where that run does not solve it."""
    b: ScoredBest | None

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


def effort_of(run: Run) -> Effort:
    """The effort of a run so far.

    Refiner calls that only complete a scene in a roll-out count apart, as in the paper's comparison with PHYSIM-MCTS
    (docs/methods.md 3.3).
    """
    done = run.iterations
    planned = run.length if run.is_done else max(run.n_iterations, run.length + 1)
    calls = sum(stage.name == "refined" for i in done for stage in i.stages)
    rollouts = sum(len(i.tree.rollout) for i in done if i.tree is not None)
    return Effort(len(done), planned, calls, rollouts, sum(i.ms for i in done))


def outcomes(
    a: Run,
    b: Run,
    errors_of: ErrorsOf,
    score_of: Callable[[Target, Best], float] | None = None,
) -> tuple[ComparedObject, ...]:
    """The answers of both runs so far, object by object.

    Args:
        a: one run.
        b: the other.
        errors_of: errors of a pose against ground truth, None where there is none.
        score_of: score of B's answer by the rule of A; None = both score alike, B's own score will do.
    """

    def answers(run: Run, score_of: Callable[[Target, Best], float] | None = None) -> dict[int, ScoredBest]:
        scored: dict[int, ScoredBest] = {}
        for own, best in run.best_at(run.length).items():
            target = run.problem.target(own)
            score = score_of(target, best) if score_of is not None else best.score.score
            scored[own] = ScoredBest(best, errors_of(target, best.T_cam_obj), score)
        return scored

    of_a, of_b = answers(a), answers(b, score_of)
    problems = {i.instance_id: run.problem for run in (b, a) for i in run.problem.instances}
    ids = dict.fromkeys(i.instance_id for run in (a, b) for i in run.problem.instances)
    return tuple(ComparedObject(own, name_of(problems[own], own), of_a.get(own), of_b.get(own)) for own in ids)
