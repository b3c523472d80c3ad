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
from verefine_viz.run.compare import Differences, Moment, Timeline, Trace, name_of
from verefine_viz.run.outcomes import Effort, Outcome, effort_of, outcomes
from verefine_viz.run.variants import scores_alike, settings_between
from verefine_viz.viewer.commands import SidePose
from verefine_viz.viewer.state.branch import Branch
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator, together
from verefine_viz.viewer.state.state import Compared, Comparison


@dataclass(frozen=True, eq=False)
class DrawnPose:
    """What is drawn of an object in one run at the moment that is shown."""

    T_cam_obj: Float
    iteration: int
    """The one that it comes from; 0 = an initial pose."""
    arm: int
    """The hypothesis that it belongs to, from 0."""
    stage: StageName
    """What it was in its iteration."""
    score: float | None
    """By the rule of its own run."""
    errors: PoseErrors | None


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
    """Whether both score by the same rule."""
    timeline: Timeline
    place: int
    moment: Moment | None
    """The one shown; None = before the first."""
    focus: str
    """Name of the object in focus."""
    curves_of: str
    """What the curves show, over what."""
    differences: Differences
    outcomes: tuple[Outcome, ...]
    """The answers so far, at the end of what is computed."""
    frame_scores: tuple[float, float] | None
    """How well all answers of A and all of B explain the frame together; None for one object."""
    effort_a: Effort
    effort_b: Effort
    now_a: DrawnPose | None
    """Of the object in focus; None where A does not solve it."""
    now_b: DrawnPose | None
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
    """The comparison at this moment; None while nothing is compared.

    Args:
        comparison: which runs.
        a: the open one.
        focus: the object in focus.
        chosen: whether the user chose it; else it is the one of the moment.
        whole_scene: whether curves are of all objects together.
    """
    compared, b, choice = comparison.compared(), comparison.branch_b(), comparison.choice
    if compared is None or b is None or choice is None:
        return None
    evaluator, timeline = a.evaluator, compared.timeline
    place = comparison.place()
    moment = timeline.moments[place - 1] if place else None
    if moment is not None and not chosen and moment.instance_id in compared.a.instance_ids:
        focus = compared.a.problem.target(moment.instance_id)
    own = focus.instance.instance_id
    # With what was changed on the way, as its answers are scored.
    alike = scores_alike(a.settings, b.settings)
    between = settings_between(a.settings, b.settings)
    name, (name_a, name_b) = name_of(compared.a.problem, own), _names(a, b, between)
    drawn = {
        instance_id: _drawn(compared, place, instance_id, choice.poses, evaluator)
        for instance_id in dict.fromkeys((*compared.a.instance_ids, *compared.b.instance_ids))
    }
    now_a, now_b = drawn.get(own, (None, None))

    def score_of(target: Target, best: Best) -> float:
        """By the rule of A, whose own target of the same object may count other masks."""
        instance_id = target.instance.instance_id
        ours = compared.a.problem.target(instance_id) if instance_id in compared.a.instance_ids else target
        return evaluator.score(ours, best.T_cam_obj).score

    answers = outcomes(compared.a, compared.b, evaluator.errors, None if alike else score_of)
    return ComparisonSnapshot(
        name_a=name_a,
        name_b=name_b,
        index_b=choice.b,
        settings=between,
        scores_alike=alike,
        timeline=timeline,
        place=place,
        moment=moment,
        focus=name,
        curves_of="All objects, means over the moments" if whole_scene else f"{name}, by refiner calls",
        differences=compared.differences,
        outcomes=answers,
        frame_scores=_frame_scores(compared, a, b, answers),
        effort_a=effort_of(compared.a),
        effort_b=effort_of(compared.b),
        now_a=now_a,
        now_b=now_b,
        curves=_scene_curves(compared, evaluator) if whole_scene else _curves(compared, evaluator, own),
        poses={k: (x.T_cam_obj if x else None, y.T_cam_obj if y else None) for k, (x, y) in drawn.items()},
        which=choice.poses,
        shown=choice.shown,
        running=comparison.is_running,
    )


def _drawn(
    compared: Compared, place: int, instance_id: int, which: SidePose, evaluator: CachedEvaluator
) -> tuple[DrawnPose | None, DrawnPose | None]:
    """What is drawn of an object in both runs: the best pose so far, or the one that its latest iteration accepted."""

    def of(trace: Trace, latest: int, until: int) -> DrawnPose | None:
        best = trace.answers[min(until, len(trace.answers) - 1)].get(instance_id)
        if best is None:
            return None
        errors, target = evaluator.errors, trace.problem.target(instance_id)
        if which == "best" or latest == 0:
            T = best.T_cam_obj
            return DrawnPose(T, best.iteration, best.arm, best.stage, best.score.score, errors(target, T))
        iteration = trace.iterations[latest - 1]
        stage, T = iteration.accepted_stage, iteration.accepted_stage.T_cam_obj
        score = stage.score.score if stage.score else None
        return DrawnPose(T, latest, iteration.arm, stage.name, score, errors(target, T))

    k_a, k_b = compared.timeline.latest(place, instance_id)
    reach_a, reach_b = compared.timeline.a_at(place), _reach(compared.timeline, place)
    return of(compared.a, k_a, reach_a), of(compared.b, k_b, max(k_b, reach_b))


def _names(a: Branch, b: Branch, between: tuple[tuple[str, Any, Any], ...]) -> tuple[str, str]:
    """What tells the two apart, as short as can be: "rir" and "sir", "c = 0.7" and "c = 0.1"."""
    changed = {name: (one, other) for name, one, other in between}
    pairs = [tuple(map(str, changed[name])) for name in ("method.name", "preset") if name in changed]
    if not pairs:
        pairs = [
            tuple(f"{name.rpartition('.')[2]} = {_short(value)}" for value in (one, other))
            for name, one, other in between[:2]
        ]
    if not pairs:
        name_a, name_b = (side.name.removeprefix("B: ") for side in (a, b))  # Which side it is on is said anyway.
        return name_a, name_b if name_b != name_a else f"{name_b} (2)"
    name_a, name_b = (
        ", ".join((*parts, side.recording.name) if side.recording else parts)
        for parts, side in zip(zip(*pairs, strict=True), (a, b), strict=True)
    )
    return name_a, name_b


def _short(value: Any) -> str:
    words = f"{value:g}" if isinstance(value, float) else str(value)
    return words if len(words) <= 24 else f"{words[:23]}…"


def _reach(timeline: Timeline, place: int) -> int:
    """Up to which iteration B is through at a place, without a gap."""
    done = {m.b for m in timeline.moments[:place] if m.b is not None}
    k = 0
    while k + 1 in done:
        k += 1
    return k


Line = list[tuple[float, float | None]]
"""Score and ADD(-S) [mm] of the best pose so far, moment by moment."""


def _curves(compared: Compared, evaluator: CachedEvaluator, own: int) -> Curves:
    """Of one object."""
    moments = [m for m in compared.timeline.moments if m.instance_id == own]
    line_a = _line(compared.a, evaluator, own, [m.a for m in moments])
    line_b = _line(compared.b, evaluator, own, [m.b for m in moments])
    return _as_curves((0, *(m.calls for m in moments)), line_a, line_b)


def _scene_curves(compared: Compared, evaluator: CachedEvaluator) -> Curves:
    """Means over the objects that both solve."""
    moments = compared.timeline.moments
    both = [i for i in compared.a.instance_ids if i in compared.b.instance_ids and i in compared.a.answers[0]]

    def mean_line(trace: Trace, indices: Sequence[int | None]) -> Line:
        places = list(zip(indices, moments, strict=True))
        lines = [_line(trace, evaluator, own, [k if m.instance_id == own else None for k, m in places]) for own in both]
        return [_mean(points) for points in zip(*lines, strict=True)]

    line_a, line_b = mean_line(compared.a, [m.a for m in moments]), mean_line(compared.b, [m.b for m in moments])
    return _as_curves(tuple(range(len(moments) + 1)), line_a, line_b)


def _line(trace: Trace, evaluator: CachedEvaluator, own: int, indices: Sequence[int | None]) -> Line:
    """Of one object, after each of the run's iterations; None = it stays where it was."""
    target = trace.problem.target(own)

    def point(best: Best | None) -> tuple[float, float | None]:
        if best is None:
            return 0.0, None
        errors = evaluator.errors(target, best.T_cam_obj)
        return best.score.score, errors.add_s_mm if errors else None

    line = [point(trace.answers[0].get(own))]
    for k in indices:
        line.append(line[-1] if k is None else point(trace.iterations[k - 1].best))
    return line


def _mean(points: Sequence[tuple[float, float | None]]) -> tuple[float, float | None]:
    errors = [e for _, e in points if e is not None]
    mean_error = sum(errors) / len(errors) if len(errors) == len(points) else None
    return sum(f for f, _ in points) / len(points), mean_error


def _as_curves(calls: tuple[int, ...], *lines: Line) -> Curves:
    scores = [tuple(f for f, _ in line) for line in lines]
    errors = [tuple(e for _, e in line if e is not None) for line in lines]
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
