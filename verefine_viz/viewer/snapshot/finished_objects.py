"""What a finished run made of each object: its answer, how far off that is, and what else the run came by."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best
from verefine_viz.diagnosis.signs import Course, Discarded, Lost, lost
from verefine_viz.diagnosis.symmetry import UndeclaredTurn
from verefine_viz.evaluation.pose_errors import PoseErrors, add_s_mm
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer.snapshot.scene_state import labels_of
from verefine_viz.viewer.state.branch import Branch
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator


@dataclass(frozen=True)
class RunnerUp:
    """The best pose of another hypothesis than the answer's."""

    pose: Best
    lead: float
    """How much more the answer scores."""
    apart_mm: float
    """ADD(-S) between it and the answer [mm]."""


@dataclass(frozen=True)
class FinishedObject:
    """One object after its last iteration, whatever the cursor shows."""

    target: Target
    label: str
    answer: Best | None
    """None where it had no hypothesis."""
    errors: PoseErrors | None
    """Of the answer; None without ground truth."""
    course: Course
    discarded: Discarded | None
    """The correct pose that was given up for a wrong answer."""
    lost: Lost | None
    """The pose near ground truth that a wrong answer came from; None where nothing led it away."""
    undeclared: UndeclaredTurn | None
    """The turn that alone makes the answer count as wrong; None where it is right, or wrong otherwise."""
    runner_up: RunnerUp | None
    """None where no other hypothesis could have been the answer."""

    @property
    def instance_id(self) -> int:
        return self.target.instance.instance_id

    def in_mm(self, share: float) -> float:
        """A share of the model's diameter [mm]."""
        return 1e3 * self.target.model.diameter_m * share


def finished_objects(branch: Branch) -> tuple[FinishedObject, ...]:
    """Every object of a branch whose run is over, in the order of the frame; empty while it is not."""
    run = branch.run
    if not run.is_done or not run.length:
        return ()
    evaluator, state, labels = branch.final_evaluator, run.final_state, labels_of(run.problem)
    return tuple(
        _finished(branch, evaluator, target, own, best, labels[target.instance.instance_id])
        for target, own, best in zip(state.problem.targets, state.objects, state.best, strict=True)
    )


def _finished(
    branch: Branch,
    evaluator: CachedEvaluator,
    target: Target,
    own: Any,
    best: Best | None,
    label: str,
) -> FinishedObject:
    """``own``: the method's state of the object; None where it has no hypothesis."""
    if best is None or own is None:
        return FinishedObject(target, label, None, None, Course((), (), None, None, None), None, None, None, None)
    method = method_of(branch.settings.method.name)
    iterations = [i for i in branch.run.iterations if i.instance_id == target.instance.instance_id]
    errors, T_gt = evaluator.errors(target, best.T_cam_obj), target.instance.T_cam_obj_gt
    starts = [
        next((e for e in reversed(arm.entries) if e.stage == "edited" and e.iteration == 0), arm.entries[0])
        for arm in own.arms
    ]
    course = Course(
        tuple(evaluator.errors(target, start.T_cam_obj) for start in starts),
        tuple(sum(i.arm == j for i in iterations) for j in range(len(own.arms))),
        errors,
        best.score,
        evaluator.score(target, T_gt) if T_gt is not None else None,
    )
    given_up = branch.discarded().get(target.instance.instance_id)
    led_away = None
    if course.is_wrong and not method.has_tree:
        led_away = lost(iterations, best, partial(_error, evaluator, target))
    undeclared = evaluator.undeclared_turn(target, best.T_cam_obj) if course.is_wrong else None
    runner_up = _runner_up(own, best, target) if method.answers_best_of_all else None
    return FinishedObject(target, label, best, errors, course, given_up, led_away, undeclared, runner_up)


def _error(evaluator: CachedEvaluator, target: Target, T_cam_obj: Float) -> float | None:
    errors = evaluator.errors(target, T_cam_obj)
    return None if errors is None else errors.relative


def _runner_up(own: Any, best: Best, target: Target) -> RunnerUp | None:
    others = [entry.as_best(j) for j, arm in enumerate(own.arms) if j != best.arm for entry in arm.entries]
    if not others:
        return None
    rival = max(others, key=lambda pose: pose.score.score)
    lead = best.score.score - rival.score.score
    return RunnerUp(rival, lead, add_s_mm(target.model, rival.T_cam_obj, best.T_cam_obj))
