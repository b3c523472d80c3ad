"""Two runs of one frame against each other: aligned iterations, and the first differences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import angle_between
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Best, Iteration
from verefine_viz.run.engine import Run


@dataclass(frozen=True, eq=False)
class Trace:
    """A run from the outside: what it started from, what it did, and its answers on the way."""

    problem: Problem
    initial: Mapping[int, tuple[float, ...]]
    """Scores of the hypotheses before iteration 1, by instance_id; none where the pool is empty."""
    iterations: tuple[Iteration, ...]
    """1, 2, …"""
    answers: tuple[Mapping[int, Best], ...]
    """By instance_id, after 0, 1, 2, … iterations; an object without hypotheses has none."""
    n_planned: int
    """Iterations that the whole run will have."""

    @property
    def is_done(self) -> bool:
        """Whether nothing more will come."""
        return len(self.iterations) >= self.n_planned

    @property
    def instance_ids(self) -> tuple[int, ...]:
        return tuple(i.instance_id for i in self.problem.instances)

    @cached_property
    def own(self) -> Mapping[int, tuple[Iteration, ...]]:
        """The iterations of each instance, by instance_id."""
        return {i: tuple(it for it in self.iterations if it.instance_id == i) for i in self.instance_ids}


def trace_of(run: Run) -> Trace:
    """All that ``run`` did so far."""
    problem = run.problem
    ids = [i.instance_id for i in problem.instances]
    states = [run.state_at(k) for k in range(run.length + 1)]
    initial = {
        i: tuple(float(s) for s in scores.score) if scores is not None else ()
        for i, scores in zip(ids, states[0].initial, strict=True)
    }
    answers = tuple({i: best for i, best in zip(ids, state.best, strict=True) if best is not None} for state in states)
    planned = run.length if run.is_done else max(run.n_iterations, run.length + 1)
    return Trace(problem, initial, run.iterations, answers, planned)


def refiner_calls(iteration: Iteration) -> int:
    """Calls of the refiner that an iteration spent on its own object.

    Those that only complete a scene in a roll-out are not counted, as in the paper's comparison with PHYSIM-MCTS
    (docs/methods.md 3.3); :func:`rollout_calls` has them.
    """
    return sum(stage.name == "refined" for stage in iteration.stages)


def rollout_calls(iteration: Iteration) -> int:
    """Calls of the refiner that only completed a scene."""
    return len(iteration.tree.rollout) if iteration.tree is not None else 0


# Which iteration of one run stands beside which of another.
#
# Runs differ in length and in the order in which they take the objects, so iteration 17 of one says nothing about
# iteration 17 of the other. What can be compared is an object after the same effort: the refiner calls spent on it. A
# timeline is a walk through such moments. Along it each object goes forward in both runs, in the order of the first;
# what only the second has is put in as early as its own order allows. Where both runs have the same structure, moment k
# is iteration k of both.

Key = tuple[int, int, int]
"""(instance_id, refiner calls spent on it, which of several iterations with that number): names a moment while both
runs grow."""


@dataclass(frozen=True)
class Moment:
    """One object after the same number of refiner calls in both runs."""

    key: Key
    a: int | None
    """Index of A's iteration of this moment, from 1; None where A has none, and stays where it was."""
    b: int | None

    @property
    def instance_id(self) -> int:
        return self.key[0]

    @property
    def calls(self) -> int:
        return self.key[1]


@dataclass(frozen=True)
class Timeline:
    """All moments of two runs; place 0 is before the first."""

    moments: tuple[Moment, ...]

    def __len__(self) -> int:
        return len(self.moments)

    @cached_property
    def _places(self) -> dict[Key, int]:
        return {m.key: k for k, m in enumerate(self.moments, 1)}

    def place(self, key: Key | None) -> int | None:
        """Where that moment is, from 1; None = there is no such moment."""
        return self._places.get(key) if key is not None else None

    def of_a(self, index: int) -> int:
        """Where A's iteration ``index`` is; 0 before the first."""
        return next((k for k, m in enumerate(self.moments, 1) if m.a == index), 0)

    def a_at(self, place: int) -> int:
        """The latest iteration that A has made at that place; 0 = none."""
        return max((m.a for m in self.moments[:place] if m.a is not None), default=0)

    def latest(self, place: int, instance_id: int) -> tuple[int, int]:
        """The last iterations of A and of B on an object up to a place; 0 = none yet."""
        a = b = 0
        for moment in self.moments[:place]:
            if moment.instance_id == instance_id:
                a, b = moment.a or a, moment.b or b
        return a, b


def keys_of(iterations: Sequence[Iteration]) -> tuple[Key, ...]:
    """The moment at which each iteration is."""
    calls: dict[int, int] = {}
    seen: dict[tuple[int, int], int] = {}
    keys: list[Key] = []
    for iteration in iterations:
        own = iteration.instance_id
        calls[own] = calls.get(own, 0) + refiner_calls(iteration)
        n = seen.get((own, calls[own]), 0)
        seen[own, calls[own]] = n + 1
        keys.append((own, calls[own], n))
    return tuple(keys)


def aligned(a: Trace, b: Trace) -> Timeline:
    """The timeline of two runs: every iteration of both is in one moment."""
    keys_a, keys_b = keys_of(a.iterations), keys_of(b.iterations)
    in_b = {key: k for k, key in enumerate(keys_b, 1)}
    in_a = set(keys_a)
    only_b = [key for key in keys_b if key not in in_a]
    last_of_a = {key[0]: k for k, key in enumerate(keys_a)}
    moments: list[Moment] = []
    placed: set[Key] = set()

    def put(key: Key, k: int | None) -> None:
        moments.append(Moment(key, k, in_b.get(key)))
        placed.add(key)

    def follows(key: Key, now: int) -> bool:
        """Whether B alone goes on here: A is through with the object, and B's iteration before is placed."""
        before = keys_b[in_b[key] - 2] if in_b[key] > 1 else None
        return last_of_a.get(key[0], -1) <= now and (before is None or before in placed)

    for now, key in enumerate(keys_a):
        for waiting in [w for w in only_b if w[0] == key[0] and w < key]:
            put(waiting, None)
            only_b.remove(waiting)
        put(key, now + 1)
        while only_b and follows(only_b[0], now):
            put(only_b.pop(0), None)
    for key in only_b:
        put(key, None)
    return Timeline(tuple(moments))


# Where two runs differ: two traces in, sentences out. "A" and "B" are the two runs; every sentence is about what B does
# otherwise.

Kind = Literal["start", "missing", "hypothesis", "placed", "stages", "pose", "accepted", "score", "answer"]


@dataclass(frozen=True)
class Difference:
    """One thing that B does otherwise than A."""

    place: int
    """On the timeline; 0 = before iteration 1."""
    instance_id: int
    kind: Kind
    text: str
    """What B does, after "B": "works on hypothesis 2 instead of 1"."""
    a: int | None = None
    """Index of A's iteration."""
    b: int | None = None


@dataclass(frozen=True)
class Differences:
    """The first differences of two runs."""

    deed: Difference | None
    """First thing that is done otherwise: other object, hypothesis, pose, or accepted stage."""
    score: Difference | None
    """First score that differs although the pose is the same."""

    @property
    def first(self) -> Difference | None:
        """The one that comes first on the timeline."""
        return min(filter(None, (self.deed, self.score)), key=lambda d: d.place, default=None)


def differences(a: Trace, b: Trace, timeline: Timeline) -> Differences:
    """The first differences along the timeline.

    A moment that only one of them has so far counts when the other is done with its run.
    """
    deed = score = None
    for difference in _all_differences(a, b, timeline):
        if difference.kind == "score":
            score = score or difference
        else:
            deed = deed or difference
        if deed and (score or difference.place > deed.place):
            break
    return Differences(deed, score)


def first_difference(a: Trace, b: Trace, timeline: Timeline) -> Difference | None:
    """The first difference of any kind along the timeline; None where both did the same, bit for bit."""
    return differences(a, b, timeline).first


def _all_differences(a: Trace, b: Trace, timeline: Timeline) -> Iterator[Difference]:
    """Every difference, in the order of the timeline."""
    yield from _starts(a, b)
    for place, moment in enumerate(timeline.moments, 1):
        yield from _at_moment(a, b, moment, place)


def _starts(a: Trace, b: Trace) -> Iterator[Difference]:
    """What differs before the first iteration."""
    for own in sorted({*a.instance_ids, *b.instance_ids}):
        if own not in a.instance_ids or own not in b.instance_ids:
            who = "does not solve" if own in a.instance_ids else "also solves"
            problem = a.problem if own in a.instance_ids else b.problem
            yield Difference(0, own, "start", f"{who} {name_of(problem, own)}")
            continue
        ours = a.problem.target(own).instance.hypotheses
        theirs = b.problem.target(own).instance.hypotheses
        name = name_of(a.problem, own)
        if len(ours) != len(theirs):
            yield Difference(
                0, own, "start", f"has {_n(len(theirs), 'hypothesis', 'hypotheses')} of {name}, A has {len(ours)}"
            )
            continue
        for j, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            if not same_pose(one.T_cam_obj, other.T_cam_obj):
                far = apart(one.T_cam_obj, other.T_cam_obj)
                yield Difference(0, own, "start", f"starts hypothesis {j + 1} of {name} {far} away")
        for j, (f_a, f_b) in enumerate(zip(a.initial.get(own, ()), b.initial.get(own, ()), strict=False)):
            if f_a != f_b and same_pose(ours[j].T_cam_obj, theirs[j].T_cam_obj):
                yield Difference(
                    0, own, "score", f"scores the initial pose of {name}'s hypothesis {j + 1} {instead(f_b, f_a)}"
                )


def _at_moment(a: Trace, b: Trace, moment: Moment, place: int) -> Iterator[Difference]:
    """What differs in one moment, what is done before what it scores."""
    one = a.iterations[moment.a - 1] if moment.a else None
    other = b.iterations[moment.b - 1] if moment.b else None

    def difference(kind: Kind, text: str) -> Difference:
        return Difference(place, moment.instance_id, kind, text, moment.a, moment.b)

    name = name_of(a.problem if moment.instance_id in a.instance_ids else b.problem, moment.instance_id)
    if one is None or other is None:
        if other is None and b.is_done:
            yield difference("missing", f"has no refiner call {moment.calls} on {name}, A goes on")
        if one is None and a.is_done:
            yield difference("missing", f"goes on with refiner call {moment.calls} on {name}, A does not")
        return
    yield from (difference(kind, text) for kind, text in _deeds(one, other, name))
    yield from (difference("score", text) for text in _scores(one, other, name))
    best_a, best_b = one.best, other.best
    if not same_pose(best_a.T_cam_obj, best_b.T_cam_obj):
        far = apart(best_a.T_cam_obj, best_b.T_cam_obj)
        yield difference("answer", f"has its best pose of {name} {far} away")


def _deeds(one: Iteration, other: Iteration, name: str) -> Iterator[tuple[Kind, str]]:
    if one.arm != other.arm:
        yield "hypothesis", f"works on hypothesis {other.arm + 1} of {name} instead of {one.arm + 1}"
    ours, theirs = [p.instance_id for p in one.placed], [p.instance_id for p in other.placed]
    if ours != theirs:
        yield "placed", f"has {_n(len(theirs), 'object', 'objects')} placed beside {name}, A has {len(ours)}"
    for p, q in zip(one.placed, other.placed, strict=False):
        if p.instance_id == q.instance_id and not same_pose(p.T_cam_obj, q.T_cam_obj):
            yield "placed", f"has a neighbour of {name} placed {apart(p.T_cam_obj, q.T_cam_obj)} away"
            break
    names_a, names_b = [s.name for s in one.stages], [s.name for s in other.stages]
    if names_a != names_b:
        yield "stages", f"goes through {', '.join(names_b)} with {name} instead of {', '.join(names_a)}"
    for stage in other.stages:
        ours_of = one.stage(stage.name)
        if ours_of is not None and not same_pose(ours_of.T_cam_obj, stage.T_cam_obj):
            yield "pose", f"has its {stage.name} pose of {name} {apart(ours_of.T_cam_obj, stage.T_cam_obj)} away"
    if one.accepted != other.accepted:
        yield "accepted", f"accepts the {other.accepted} pose of {name} instead of the {one.accepted} one"


def _scores(one: Iteration, other: Iteration, name: str) -> Iterator[str]:
    for stage in other.stages:
        ours = one.stage(stage.name)
        if ours is None or not same_pose(ours.T_cam_obj, stage.T_cam_obj):
            continue
        f_a = ours.score.score if ours.score else None
        f_b = stage.score.score if stage.score else None
        if f_a != f_b:
            yield f"scores the {stage.name} pose of {name} {instead(f_b, f_a)}"


def same_pose(T_a: Float, T_b: Float) -> bool:
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
