"""One moment of a comparison, frozen: what the A/B panel and the 3D scene need to draw it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best, StageName
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.session.comparison import Differences, Moment, Timeline, Trace, name_of
from verefine_viz.session.outcomes import Effort, Outcome, effort_of, outcomes
from verefine_viz.session.variants import scores_alike, settings_between
from verefine_viz.viewer.comparison_commands import SidePose
from verefine_viz.viewer.state.branch import Branch
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator, together
from verefine_viz.viewer.state.comparison import Compared, Comparison


@dataclass(frozen=True, eq=False)
class RunAtMoment:
    """One run at the moment that is shown, for the object in focus."""

    iteration: int
    """The one that the pose drawn comes from; 0 = an initial pose."""
    arm: int
    """The hypothesis that the pose drawn belongs to, from 0."""
    stage: StageName
    """What the pose drawn was in its iteration."""
    score: float | None
    """Of the pose drawn, by the rule of its own run."""
    errors: PoseErrors | None
    """Of the pose drawn."""


@dataclass(frozen=True, eq=False)
class Curves:
    """One object in both runs over the refiner calls spent on it; a run that has ended stays where it was.

    For the whole scene: means over all objects, over the moments of the timeline.
    """

    calls: tuple[int, ...]
    score_a: tuple[float, ...]
    """Of the best pose so far, by the rule of its own run."""
    score_b: tuple[float, ...]
    error_a: tuple[float, ...] | None
    """ADD(-S) of the best pose so far [mm]; None without ground truth."""
    error_b: tuple[float, ...] | None


@dataclass(frozen=True, eq=False)
class ComparisonSnapshot:
    """Two runs at one moment."""

    name_a: str
    name_b: str
    index_b: int
    """Of B among the branches."""
    settings: tuple[tuple[str, Any, Any], ...]
    """What differs in the settings: (dotted name, of A, of B)."""
    scores_alike: bool
    """Whether both judge by the same rule."""
    timeline: Timeline
    place: int
    moment: Moment | None
    """The one shown; None = before the first."""
    focus: str
    """The object in focus, for people."""
    curves_of: str
    """What the curves tell of, over what."""
    differences: Differences
    outcomes: tuple[Outcome, ...]
    """The answers so far, at the end of what is computed."""
    frame_scores: tuple[float, float] | None
    """How well all answers of A and all of B explain the frame together; None for one object."""
    effort_a: Effort
    effort_b: Effort
    now_a: RunAtMoment | None
    """None where A does not solve the object in focus."""
    now_b: RunAtMoment | None
    curves: Curves
    poses: Mapping[int, tuple[Float | None, Float | None]]
    """What is drawn of each object: pose of A, pose of B."""
    which: SidePose
    shown: frozenset[str]
    running: bool
    """Whether B is being computed."""


def comparison_snapshot(
    comparison: Comparison, a: Branch, focus: Target, chosen: bool, whole_scene: bool
) -> ComparisonSnapshot | None:
    """The comparison at this moment; None while one run is looked at alone.

    Args:
        comparison: which runs.
        a: the open one.
        focus: the object that the page is about.
        chosen: whether a person chose it; else it is the one of the moment.
        whole_scene: whether curves are of all objects together.
    """
    compared, b, sides = comparison.compared(), comparison.branch_b(), comparison.choice
    if compared is None or b is None or sides is None:
        return None
    place = comparison.place()
    moment = compared.timeline.moments[place - 1] if place else None
    if moment is not None and not chosen and moment.instance_id in compared.a.instance_ids:
        focus = compared.a.problem.target(moment.instance_id)
    own = focus.instance.instance_id
    # With what was changed on the way, as its answers are scored.
    session_a, session_b = a.settings, b.settings
    alike = scores_alike(session_a, session_b)
    evaluator = a.evaluator
    between = settings_between(session_a, session_b)
    name_a, name_b = names(a, b, between)
    reach_b = _reach(compared.timeline, place)

    def score_of(target: Target, best: Best) -> float:
        return evaluator.score(_ours(compared, target), best.T_cam_obj).score

    def kept(k: int) -> int:
        """The iteration whose kept pose is drawn, where the latest one is ``k``; 0 = the best pose so far is drawn."""
        return k if sides.poses == "kept" else 0

    def pose(trace: Trace, instance_id: int, k: int, until: int) -> Float | None:
        best = _best(trace, instance_id, until)
        if best is None or kept(k) == 0:
            return best.T_cam_obj if best else None
        return trace.iterations[k - 1].accepted_stage.T_cam_obj

    poses: dict[int, tuple[Float | None, Float | None]] = {}
    for instance_id in dict.fromkeys((*compared.a.instance_ids, *compared.b.instance_ids)):
        k_a, k_b = compared.timeline.latest(place, instance_id)
        poses[instance_id] = (
            pose(compared.a, instance_id, k_a, compared.timeline.a_at(place)),
            pose(compared.b, instance_id, k_b, max(k_b, reach_b)),
        )
    k_a, k_b = compared.timeline.latest(place, own)
    name = name_of(compared.a.problem, own)
    answers = outcomes(compared.a, compared.b, evaluator.errors, None if alike else score_of)
    return ComparisonSnapshot(
        name_a,
        name_b,
        sides.b,
        between,
        alike,
        compared.timeline,
        place,
        moment,
        name,
        "All objects, means over the moments"
        if whole_scene
        else f"{name_of(compared.a.problem, own)}, by refiner calls",
        compared.differences,
        answers,
        _frame_scores(compared, a, b, answers),
        effort_of(compared.a),
        effort_of(compared.b),
        _now(compared.a, evaluator, focus, kept(k_a), compared.timeline.a_at(place)) if own in poses else None,
        _now(compared.b, evaluator, focus, kept(k_b), max(k_b, reach_b)) if own in poses else None,
        _scene_curves(compared, evaluator) if whole_scene else _curves(compared, evaluator, focus.instance.instance_id),
        poses,
        sides.poses,
        sides.shown,
        comparison.is_running,
    )


def names(a: Branch, b: Branch, between: tuple[tuple[str, Any, Any], ...]) -> tuple[str, str]:
    """What tells the two apart, as short as can be: "rir" and "sir", "c = 0.7" and "c = 0.1"."""
    changed = {name: (one, other) for name, one, other in between}
    pairs: list[tuple[str, str]] = []
    for name in ("method.name", "preset"):
        if name in changed:
            pairs.append((str(changed[name][0]), str(changed[name][1])))
    if not pairs:
        for name, one, other in between[:2]:
            key = name.rpartition(".")[2]
            pairs.append((f"{key} = {_short(one)}", f"{key} = {_short(other)}"))
    if not pairs:
        name_a, name_b = (side.name.removeprefix("B: ") for side in (a, b))  # Which side it is on is said anyway.
        return name_a, name_b if name_b != name_a else f"{name_b} (2)"
    one, other = (", ".join(side) for side in zip(*pairs, strict=True))
    files = [side.recording.name if side.recording else "" for side in (a, b)]
    return tuple(f"{n}, {file}" if file else n for n, file in zip((one, other), files, strict=True))  # type: ignore[return-value]


def _short(value: Any) -> str:
    said = f"{value:g}" if isinstance(value, float) else str(value)
    return said if len(said) <= 24 else f"{said[:23]}…"


def _reach(timeline: Timeline, place: int) -> int:
    """Up to which iteration B is through at a place, without a gap."""
    done = {m.b for m in timeline.moments[:place] if m.b is not None}
    k = 0
    while k + 1 in done:
        k += 1
    return k


def _best(trace: Trace, instance_id: int, until: int) -> Best | None:
    """The answer for an object after the run's iteration ``until``."""
    return trace.answers[min(until, len(trace.answers) - 1)].get(instance_id)


def _ours(compared: Compared, target: Target) -> Target:
    """A's own target of the same object: its rule may count other masks."""
    own = target.instance.instance_id
    return compared.a.problem.target(own) if own in compared.a.instance_ids else target


def _now(trace: Trace, evaluator: CachedEvaluator, focus: Target, kept: int, until: int) -> RunAtMoment | None:
    """What is drawn of the object in focus: the pose that iteration ``kept`` kept, or for 0 the best one so far."""
    best = _best(trace, focus.instance.instance_id, until)
    if best is None:
        return None
    if not kept:
        errors = evaluator.errors(focus, best.T_cam_obj)
        return RunAtMoment(best.iteration, best.arm, best.stage, best.score.score, errors)
    iteration = trace.iterations[kept - 1]
    stage = iteration.accepted_stage
    score = stage.score.score if stage.score else None
    return RunAtMoment(kept, iteration.arm, stage.name, score, evaluator.errors(focus, stage.T_cam_obj))


def _curves(compared: Compared, evaluator: CachedEvaluator, own: int) -> Curves:
    """Of one object."""
    moments = [m for m in compared.timeline.moments if m.instance_id == own]
    sides = [
        _line(compared.a, evaluator, own, [m.a for m in moments]),
        _line(compared.b, evaluator, own, [m.b for m in moments]),
    ]
    return _drawn((0, *(m.calls for m in moments)), sides)


def _scene_curves(compared: Compared, evaluator: CachedEvaluator) -> Curves:
    """Means over the objects that both solve."""
    moments = compared.timeline.moments
    both = [i for i in compared.a.instance_ids if i in compared.b.instance_ids and i in compared.a.answers[0]]
    sides: list[Line] = []
    for trace, pick in ((compared.a, "a"), (compared.b, "b")):
        lines = [
            _line(trace, evaluator, own, [getattr(m, pick) if m.instance_id == own else None for m in moments])
            for own in both
        ]
        sides.append([_mean(points) for points in zip(*lines, strict=True)])
    return _drawn(tuple(range(len(moments) + 1)), sides)


Line = list[tuple[float, float | None]]
"""Score and ADD(-S) [mm] of the best pose so far, moment by moment."""


def _line(trace: Trace, evaluator: CachedEvaluator, own: int, indices: Sequence[int | None]) -> Line:
    target, now = trace.problem.target(own), trace.answers[0].get(own)
    line = [_point(evaluator, target, now)]
    for k in indices:
        now = now if k is None else trace.iterations[k - 1].best
        line.append(line[-1] if k is None else _point(evaluator, target, now))
    return line


def _point(evaluator: CachedEvaluator, target: Target, best: Best | None) -> tuple[float, float | None]:
    if best is None:
        return 0.0, None
    errors = evaluator.errors(target, best.T_cam_obj)
    return best.score.score, errors.add_s_mm if errors else None


def _mean(points: Sequence[tuple[float, float | None]]) -> tuple[float, float | None]:
    errors = [e for _, e in points if e is not None]
    mean_error = sum(errors) / len(errors) if len(errors) == len(points) else None
    return sum(f for f, _ in points) / len(points), mean_error


def _drawn(calls: tuple[int, ...], sides: Sequence[Line]) -> Curves:
    scores = [tuple(f for f, _ in line) for line in sides]
    errors = [tuple(e for _, e in line if e is not None) for line in sides]
    known = all(len(e) == len(f) for e, f in zip(errors, scores, strict=True)) and bool(scores[0])
    return Curves(calls, scores[0], scores[1], errors[0] if known else None, errors[1] if known else None)


def _frame_scores(compared: Compared, a: Branch, b: Branch, answers: tuple[Outcome, ...]) -> tuple[float, float] | None:
    """Of all answers of A and of B together: by the settings of A, or where B scores by others, of B by its own."""
    both = [(o.instance_id, o.a.best, o.b.best) for o in answers if o.a is not None and o.b is not None]
    if len(both) < 2:
        return None
    alike = scores_alike(a.settings, b.settings)
    evaluator_b, session_b, problem_b = (
        (a.evaluator, a.settings, compared.a.problem) if alike else (b.final_evaluator, b.settings, compared.b.problem)
    )
    one, other = np.array([x.T_cam_obj for _, x, _ in both]), np.array([x.T_cam_obj for _, _, x in both])
    score_a = together(a.evaluator, [compared.a.problem.target(own) for own, _, _ in both], one, a.settings)
    score_b = together(evaluator_b, [problem_b.target(own) for own, _, _ in both], other, session_b)
    return score_a.score, score_b.score
