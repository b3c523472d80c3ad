"""A comparison of two runs, frozen: what the A/B panel and the 3D scene need to draw it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best, StageName
from verefine_viz.evaluation.pose_errors import PoseErrors
from verefine_viz.run.compare import Departures, Effort, Outcome, Pair, effort_of, name_of, outcomes
from verefine_viz.run.engine import Run
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
    """One object in both runs over its iterations; a run that has ended stays where it was.

    For the whole scene: means over all objects, over all pairs of iterations. The first point is before iteration 1.
    """

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
    pairs: tuple[Pair, ...]
    """Iterations beside each other, in order."""
    place: int
    """Number of the pair shown, from 1; 0 = before the first."""
    pair: Pair | None
    focus: str
    """Name of the object in focus."""
    curves_of: str
    """What the curves show, over what."""
    departures: Departures
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
        chosen: whether the user chose it; else it is the one that is worked on.
        whole_scene: whether curves are of all objects together.
    """
    compared, b, choice = comparison.compared(), comparison.branch_b(), comparison.choice
    if compared is None or b is None or choice is None:
        return None
    evaluator, pairs, problem = a.evaluator, compared.pairs, compared.a.problem
    ids_a, ids_b = ([i.instance_id for i in run.problem.instances] for run in (compared.a, compared.b))
    place = comparison.place()
    pair = pairs[place - 1] if place else None
    if pair is not None and not chosen and pair.instance_id in ids_a:
        focus = problem.target(pair.instance_id)
    own = focus.instance.instance_id
    # With what was changed on the way, as its answers are scored.
    alike = scores_alike(a.settings, b.settings)
    between = settings_between(a.settings, b.settings)
    name, (name_a, name_b) = name_of(problem, own), _names(a, b, between)
    done_a, done_b = {p.a for p in pairs[:place]}, {p.b for p in pairs[:place]}
    drawn = {
        instance_id: (
            _drawn(compared.a, done_a, instance_id, choice.poses, evaluator),
            _drawn(compared.b, done_b, instance_id, choice.poses, evaluator),
        )
        for instance_id in dict.fromkeys((*ids_a, *ids_b))
    }
    now_a, now_b = drawn.get(own, (None, None))

    def score_of(target: Target, best: Best) -> float:
        """By the rule of A, whose own target of the same object may count other masks."""
        instance_id = target.instance.instance_id
        ours = problem.target(instance_id) if instance_id in ids_a else target
        return evaluator.score(ours, best.T_cam_obj).score

    curves = (
        _curves(compared, evaluator, [i for i in ids_a if i in ids_b and i in compared.a.best_at(0)], pairs)
        if whole_scene
        else _curves(compared, evaluator, [own], [p for p in pairs if p.instance_id == own])
    )
    answers = outcomes(compared.a, compared.b, evaluator.errors, None if alike else score_of)
    return ComparisonSnapshot(
        name_a=name_a,
        name_b=name_b,
        index_b=choice.b,
        settings=between,
        scores_alike=alike,
        pairs=pairs,
        place=place,
        pair=pair,
        focus=name,
        curves_of="All objects, means" if whole_scene else f"{name}, by its iterations",
        departures=compared.departures,
        outcomes=answers,
        frame_scores=_frame_scores(compared, a, b, answers),
        effort_a=effort_of(compared.a),
        effort_b=effort_of(compared.b),
        now_a=now_a,
        now_b=now_b,
        curves=curves,
        poses={k: (x.T_cam_obj if x else None, y.T_cam_obj if y else None) for k, (x, y) in drawn.items()},
        which=choice.poses,
        shown=choice.shown,
        running=comparison.is_running,
    )


def _drawn(
    run: Run, done: Set[int | None], instance_id: int, which: SidePose, evaluator: CachedEvaluator
) -> DrawnPose | None:
    """What is drawn of an object in one run after the iterations ``done``: its best pose so far, or the one that its
    latest iteration accepted.
    """
    latest = max((i for i in run.iterations_of(instance_id) if i.index in done), key=lambda i: i.index, default=None)
    # Up to where nothing is left out: iterations on others may change the answer, too.
    reached = next(k for k in count() if k + 1 not in done)
    best = run.best_at(max(reached, latest.index if latest else 0)).get(instance_id)
    if best is None:
        return None
    errors, target = evaluator.errors, run.problem.target(instance_id)
    if which == "best" or latest is None:
        T = best.T_cam_obj
        return DrawnPose(T, best.iteration, best.arm, best.stage, best.score.score, errors(target, T))
    stage, T = latest.accepted_stage, latest.accepted_stage.T_cam_obj
    score = stage.score.score if stage.score else None
    return DrawnPose(T, latest.index, latest.arm, stage.name, score, errors(target, T))


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


def _curves(compared: Compared, evaluator: CachedEvaluator, ids: Sequence[int], pairs: Sequence[Pair]) -> Curves:
    """Means over objects along ``pairs``."""
    score_a, error_a = _lines(compared.a, evaluator, ids, [pair.a for pair in pairs])
    score_b, error_b = _lines(compared.b, evaluator, ids, [pair.b for pair in pairs])
    known = error_a is not None and error_b is not None
    return Curves(score_a, score_b, error_a if known else None, error_b if known else None)


def _lines(
    run: Run, evaluator: CachedEvaluator, ids: Sequence[int], indices: Sequence[int | None]
) -> tuple[tuple[float, ...], tuple[float, ...] | None]:
    """Score and ADD(-S) [mm] of the best poses, means over objects, before and after each of the iterations; with None
    they stay. Errors are None where one is unknown.
    """

    def error(instance_id: int, best: Best) -> float:
        errors = evaluator.errors(run.problem.target(instance_id), best.T_cam_obj)
        return errors.add_s_mm if errors else np.nan

    iterations, start = run.iterations, run.best_at(0)
    scores = {own: start[own].score.score if own in start else 0.0 for own in ids}
    errors = {own: error(own, start[own]) if own in start else np.nan for own in ids}
    lines = [(_mean(scores), _mean(errors))]
    for k in indices:
        if k is not None and (own := iterations[k - 1].instance_id) in scores:
            best = iterations[k - 1].best
            scores[own], errors[own] = best.score.score, error(own, best)
        lines.append((_mean(scores), _mean(errors)))
    score, add_s_mm = zip(*lines, strict=True)
    return score, None if np.isnan(add_s_mm).any() else add_s_mm


def _mean(values: Mapping[int, float]) -> float:
    return sum(values.values()) / len(values) if values else np.nan


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
