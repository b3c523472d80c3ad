"""When a running method should stop and wait for the person."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.geometry import angle_between
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Iteration, Stage
from verefine_viz.core.settings import BreakpointSettings
from verefine_viz.evaluation.errors import add_s_mm


def hits(settings: BreakpointSettings, problem: Problem, iteration: Iteration) -> tuple[str, ...]:
    """Why the run should stop after ``iteration``, a sentence each; empty = go on."""
    current, kept = iteration.stages[0], iteration.accepted_stage
    kinds = {event.kind: event.text for event in iteration.events}
    found: list[str] = []
    fall = _score(current) - _score(kept)
    if settings.score_falls_by is not None and fall > settings.score_falls_by:
        found.append(f"the score fell by {fall:.3f}")
    if settings.simulated_rejected and "kept_refined" in kinds:
        found.append(f"simulated pose rejected: {kinds['kept_refined']}")
    if settings.refined_rejected and "kept_simulated" in kinds:
        found.append(kinds["kept_simulated"])
    jump_mm = 1e3 * float(np.linalg.norm(kept.T_cam_obj[:3, 3] - current.T_cam_obj[:3, 3]))
    if settings.jump_mm is not None and jump_mm > settings.jump_mm:
        found.append(f"the pose jumped by {jump_mm:.1f} mm")
    jump_deg = float(np.rad2deg(angle_between(current.T_cam_obj[:3, :3], kept.T_cam_obj[:3, :3])))
    if settings.jump_deg is not None and jump_deg > settings.jump_deg:
        found.append(f"the pose turned by {jump_deg:.1f}°")
    asked = {
        "arm_switched": settings.arm_switched,
        "unstable": settings.unstable,
        "empty_render": settings.empty_render,
        "nan_score": settings.empty_render,
    }
    found += [kinds[kind] for kind, wanted in asked.items() if wanted and kind in kinds]
    if settings.error_grows_by_mm is not None:
        growth = _error_growth_mm(problem, iteration)
        if growth is not None and growth > settings.error_grows_by_mm:
            found.append(f"the error against ground truth grew by {growth:.1f} mm")
    return tuple(found)


def _score(stage: Stage) -> float:
    return stage.score.score if stage.score else 0.0


def _error_growth_mm(problem: Problem, iteration: Iteration) -> float | None:
    target = next(t for t in problem.targets if t.instance.instance_id == iteration.instance_id)
    T_gt = target.instance.T_cam_obj_gt
    if T_gt is None:
        return None
    before = add_s_mm(target.model, iteration.stages[0].T_cam_obj, T_gt)
    return add_s_mm(target.model, iteration.accepted_stage.T_cam_obj, T_gt) - before
