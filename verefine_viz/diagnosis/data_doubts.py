"""Doubts about the data of a frame that its answers show, for page and batch.

Answers show whether the support plane is what supports the objects, and where colour counts whether the colour image
lies on the depth image; before them goes what shows without a run.
Measured: docs/decisions/data-checks.md.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.calibration.camera_check import relative_distance
from verefine_viz.calibration.consistency import doubts
from verefine_viz.calibration.registration import registration_doubts
from verefine_viz.core.arrays import Float
from verefine_viz.core.doubt import Doubt, DoubtKind
from verefine_viz.core.geometry import apply
from verefine_viz.core.problem import Problem, Target

FEWEST = 3
"""Least number of objects: fewer may all be in wrong poses, or stand on something that has no model."""
FAR_M = 0.020
"""At least one of the objects that a plane supports is nearer to it, above or below [m]. True objects of YCB-V sink in
by up to 13 mm, and some stand 45 mm above on others."""
NEAR = 0.06
"""Distance of depth from the model, as a share of the diameter, within which a pose is about right and can show the
plane."""


def run_doubts(problem: Problem, poses: Sequence[Float | None], colour_weight: float = 0.0) -> tuple[Doubt, ...]:
    """Doubts about units, conventions and images, else those that answers show. Arguments: :func:`answer_doubts`."""
    return doubts(problem) or answer_doubts(problem, poses, colour_weight)


def answer_doubts(problem: Problem, poses: Sequence[Float | None], colour_weight: float = 0.0) -> tuple[Doubt, ...]:
    """Doubts that answers raise about a frame without other doubts: colour and, without ground truth, the plane.

    Args:
        problem: the frame.
        poses: T_cam_obj (4, 4), the answer for each target; None where there is none, as before a run.
        colour_weight: of the score; with 0 the place of the colour image does not matter.
    """
    at_gt = [i.T_cam_obj_gt for i in problem.instances]
    has_gt = any(T is not None for T in at_gt)
    of_plane = () if has_gt else plane_doubts(problem, poses)
    if of_plane or colour_weight == 0:
        return of_plane
    return registration_doubts(problem, at_gt if has_gt else poses)


def plane_doubts(problem: Problem, poses: Sequence[Float | None]) -> tuple[Doubt, ...]:
    """A doubt where all objects sink into the support plane, or float above it, in their answers.

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
    text = (
        f"all {n} objects {lie} in their answers: the plane is not what supports them, or cam_K is wrong; "
        "give scene.gravity, or switch physics off (physics.enabled)"
    )
    numbers = {"lowest_mm": float(heights_mm.min()), "highest_mm": float(heights_mm.max())}
    return (Doubt(DoubtKind.PLANE, text, numbers=numbers, other_settings={"physics.enabled": False}),)


def _explains_depth(target: Target, T_cam_obj: Float) -> bool:
    points_cam = target.instance.points_cam
    return len(points_cam) > 0 and relative_distance(points_cam, target.model, T_cam_obj) < NEAR
