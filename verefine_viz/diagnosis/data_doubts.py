"""Notes about data of a frame that do not fit together, where no ground truth shows it; for page and batch.

Initial poses show whether depth is in their unit, answers whether the support plane is what supports the objects, and
where colour counts either shows whether the colour image lies on the depth image.
Measured: docs/decisions/data-checks.md.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.calibration.camera_check import depth_notes, distance
from verefine_viz.calibration.consistency import doubts
from verefine_viz.calibration.registration import registration_notes
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Problem, Target

FEWEST = 3
"""Fewer objects may all be in wrong poses, or stand on something that has no model."""
FAR_M = 0.020
"""At least one of the objects that a plane supports is nearer to it, above or below [m]. True objects of YCB-V sink in
by up to 13 mm, and some stand 45 mm above on others."""
NEAR = 0.06
"""Depth within this share of the diameter shows the model in about the right pose; others do not show the plane."""
PLANE_SHARE = 0.4
"""A plane that holds less of the background is doubted. Right ones of the eight YCB-Video frames at hand hold 43-74 %,
walls in them 24-37 %, the board beside the box of the built-in failure 23 %."""


def answer_doubts(problem: Problem, poses: Sequence[Float | None], colour_weight: float = 0.0) -> tuple[str, ...]:
    """What is in doubt: units and conventions; depth and plane only without ground truth, which shows more.

    Args:
        problem: the frame.
        poses: T_cam_obj (4, 4) that answers each target, None where there is none, as before a run.
        colour_weight: of the score; with 0 it does not matter where the colour image lies.
    """
    if of_units := doubts(problem):
        return of_units
    at_gt = [i.T_cam_obj_gt for i in problem.instances]
    has_gt = any(T is not None for T in at_gt)
    of_depth = () if has_gt else depth_notes(problem) or plane_notes(problem, poses)
    if of_depth or colour_weight == 0:
        return of_depth
    return registration_notes(problem, at_gt if has_gt else poses)


def plane_notes(problem: Problem, poses: Sequence[Float | None]) -> tuple[str, ...]:
    """A note where all objects sink into the support plane, or float above it, in their answers.

    Plane and poses both come from the depth image, so that a wrong depth_scale leaves them together; where they part,
    the plane is that of something else, or cam_K bends one against the other.
    """
    support = problem.observation.support
    if support is None or support.surroundings is not None:
        return ()
    heights_mm = 1e3 * np.array(
        [
            float((apply(support.T_world_cam @ T, t.model.vertices) @ support.normal_world).min())
            for t, T in zip(problem.targets, poses, strict=True)
            if T is not None and _explains_depth(t, T)
        ]
    )
    n, far_mm = len(heights_mm), 1e3 * FAR_M
    if n < FEWEST:
        return ()
    if heights_mm.max() < -far_mm:
        lie = f"sink into the support plane, by {-heights_mm.max():.0f} to {-heights_mm.min():.0f} mm,"
    elif heights_mm.min() > far_mm:
        lie = f"float above the support plane, by {heights_mm.min():.0f} to {heights_mm.max():.0f} mm,"
    else:
        return ()
    return (
        f"all {n} objects {lie} in their answers: the plane is not what supports them, or cam_K is wrong; "
        "give scene.gravity, or switch physics off (physics.enabled)",
    )


def _explains_depth(target: Target, T_cam_obj: Float) -> bool:
    points_cam = target.instance.points_cam
    return len(points_cam) > 0 and distance(points_cam, target.model, T_cam_obj) < NEAR


def plane_doubt(support: Support) -> str:
    """Why physics may rest on a wrong plane, and what to do about it; empty where nothing says so."""
    if support.inlier_share >= PLANE_SHARE:
        return ""
    remedy = "give scene.gravity as a vector, or as world where the data set has camera poses"
    if support.gravity_source != "plane":
        remedy = "choose a frame that shows more of the table"
    return (
        f"The support plane explains only {support.inlier_share:.0%} of the background: physics may rest on a wrong "
        f"plane. If it cuts through objects in 3D, {remedy}."
    )
