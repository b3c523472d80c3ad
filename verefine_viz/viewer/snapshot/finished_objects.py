"""What a finished run made of each object, gathered for the signs of a fault."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.records import Best
from verefine_viz.diagnosis.impossible import impossible
from verefine_viz.diagnosis.lost_poses import lost
from verefine_viz.diagnosis.signs import FinishedObject, RunnerUp
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer.snapshot.scene_state import labels_of
from verefine_viz.viewer.state.branch import Branch
from verefine_viz.viewer.state.cached_evaluator import CachedEvaluator


def finished_objects(branch: Branch) -> tuple[FinishedObject, ...]:
    """Every object of a branch whose run is over, in the order of the frame; none while it is not, nor of a record that
    ended early.
    """
    run = branch.run
    if not run.is_done or not run.length or branch.missing:
        return ()
    evaluator, state, labels = branch.final_evaluator, run.final_state, labels_of(run.problem)
    placed = [
        Placed(target.instance.instance_id, target.model, best.T_cam_obj)
        for target, best in zip(state.problem.targets, state.best, strict=True)
        if best is not None
    ]
    return tuple(
        _finished(branch, evaluator, target, own, best, labels, placed)
        for target, own, best in zip(state.problem.targets, state.objects, state.best, strict=True)
    )


def _finished(
    branch: Branch,
    evaluator: CachedEvaluator,
    target: Target,
    own: Any,
    best: Best | None,
    labels: Mapping[int, str],
    placed: Sequence[Placed],
) -> FinishedObject:
    """``own``: the method's state of the object; None where it has no hypothesis. ``placed``: all answers."""
    instance_id, T_gt = target.instance.instance_id, target.instance.T_cam_obj_gt
    label = labels[instance_id]
    if best is None or own is None:
        return FinishedObject(target, label)
    method = method_of(branch.settings.method.name)
    iterations = [i for i in branch.run.iterations if i.instance_id == instance_id]
    starts = [
        next((e for e in reversed(arm.entries) if e.stage == "edited" and e.iteration == 0), arm.entries[0])
        for arm in own.arms
    ]
    o = FinishedObject(
        target,
        label,
        best,
        evaluator.errors(target, best.T_cam_obj),
        starts=tuple(evaluator.errors(target, start.T_cam_obj) for start in starts),
        n_tried=tuple(sum(i.arm == j for i in iterations) for j in range(len(own.arms))),
        score_at_gt=evaluator.score(target, T_gt) if T_gt is not None else None,
        runner_up=_runner_up(own, best, target) if method.answers_best_of_all else None,
    )
    if o.is_wrong:
        return replace(
            o,
            discarded=branch.discarded().get(instance_id),
            lost=None if method.has_tree else lost(iterations, best, partial(_error, evaluator, target)),
            undeclared=evaluator.undeclared_turn(target, best.T_cam_obj),
        )
    if o.errors is not None:
        return o
    others = [other for other in placed if other.instance_id != instance_id]
    # Among others it is worked out bit by bit, while nothing else waits.
    ask = evaluator.known_plausibility if others else evaluator.plausibility
    physics = ask(target, best.T_cam_obj, others)
    return replace(
        o,
        impossible=None if physics is None else impossible(target, physics, labels),
        around=evaluator.known_landscape(target, best.T_cam_obj),
        other_pose=evaluator.known_other_pose(target, best.T_cam_obj, iterations)[1],
    )


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
