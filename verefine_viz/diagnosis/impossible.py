"""Finds, without ground truth, answers that cannot lie where they are: they sink into something, float or tip."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.surroundings import SUPPORT_ID
from verefine_viz.diagnosis.measured_heights import MeasuredHeights
from verefine_viz.diagnosis.plane_doubt import plane_doubt
from verefine_viz.physics.stability import IMPOSSIBLE_M

if TYPE_CHECKING:
    from verefine_viz.physics.plausibility import Plausibility


def impossible(
    target: Target, placed: Placed, physics: Plausibility, labels: Mapping[int, str], heights: MeasuredHeights | None
) -> Finding | None:
    """The finding that an object cannot lie in a pose; None where it can, or only a plane or depth in doubt says so.

    Args:
        target: the object.
        placed: its pose.
        physics: of that pose.
        labels: names of objects, by instance.
        heights: what depth measures of the heights of the frame's objects, where that is in doubt.
    """
    support, into = target.observation.support, physics.penetrates
    is_of_object = into is not None and into != SUPPORT_ID
    if physics.light != "red" or support is None:
        return None
    if not is_of_object and (plane_doubt(support) or (heights and _explains(heights, placed, physics, support))):
        return None
    sentence = physics.sentence
    if into is not None and into in labels:
        sentence = sentence.replace(f"instance {into}.", f"the {labels[into]}.")
    detail = sentence.partition(":")[0]
    if physics.penetration_mm > physics.tolerance_mm:
        detail = f"Sinks {physics.penetration_mm:.1f} mm"
    elif physics.gap_mm > 1e3 * IMPOSSIBLE_M:
        detail = f"Floats {physics.gap_mm:.1f} mm"
    return Finding(
        Cause.IMPOSSIBLE,
        f"The {labels[target.instance.instance_id]} cannot lie where its answer has it. {sentence}",
        {"penetration_mm": physics.penetration_mm, "gap_mm": physics.gap_mm},
        detail=f": {detail[0].lower()}{detail[1:]}",
    )


def _explains(heights: MeasuredHeights, placed: Placed, physics: Plausibility, support: Support) -> bool:
    """Whether a pose sinks into the support, or floats, no further than heights that depth measures wrong explain."""
    up = support.T_world_cam[:3, :3].T @ support.normal_world
    explained_mm = 1e3 * heights.explained_m(float(np.ptp(placed.model.vertices @ (placed.T_cam_obj[:3, :3].T @ up))))
    sinks_mm, floats_mm = physics.penetration_mm - physics.tolerance_mm, physics.gap_mm - 1e3 * IMPOSSIBLE_M
    return 0 < sinks_mm <= explained_mm or 0 < floats_mm <= -explained_mm


def impossible_answers(
    problem: Problem,
    poses: Sequence[Float | None],
    plausibility_of: Callable[[Placed, Sequence[Placed], Support], Plausibility],
    heights: MeasuredHeights | None,
) -> dict[int, Finding]:
    """Findings on impossible answers without ground truth, by instance, each among all others.

    Args:
        problem: the frame.
        poses: T_cam_obj (4, 4) that answers each target, None where there is none.
        plausibility_of: what physics says of an object among others on the support plane.
        heights: what depth measures of heights, where that is in doubt.
    """
    support = problem.observation.support
    if support is None:
        return {}
    labels = {t.instance.instance_id: t.model.name for t in problem.targets}
    placed = {
        t.instance.instance_id: Placed(t.instance.instance_id, t.model, T)
        for t, T in zip(problem.targets, poses, strict=True)
        if T is not None
    }
    findings: dict[int, Finding] = {}
    for target in problem.targets:
        own = placed.get(target.instance.instance_id)
        if own is None or target.instance.T_cam_obj_gt is not None:
            continue
        others = [other for other in placed.values() if other is not own]
        finding = impossible(target, own, plausibility_of(own, others, support), labels, heights)
        if finding is not None:
            findings[own.instance_id] = finding
    return findings
