"""Estimates how high a depth image measures its objects, from where answers that fit put the bases of their models.

Depth may measure all that stands on a table lower than it is, and leaning, while the table itself is right: frames of
YCB-Video measure upright objects at 94 to 96 % of their height and leaning by 2 to 3°. Poses that fit such depth sink
into the support plane in proportion to their height, ground truth too. Three or more objects that agree show it, and
then sinking in by so much accuses no pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Best
from verefine_viz.physics.stability import IMPOSSIBLE_M

FEWEST = 3
"""Least number of objects that must agree."""
WELL = 0.6
"""Least score of an answer that shows where its object is."""
BASE_DEG = 15.0
"""Largest lean of a face of the hull that the object may stand on [deg]."""
SHARE = 0.15
"""A base further from the plane than this share of the height, and 5 mm, stands on something else or is wrong."""
AGREE_M, AGREE_DEG = 0.003, 2.0
"""Bases, and leans, that are nearer to what they have in common agree. Those of ground truth of YCB-Video lie within
2.5 mm, those of what is taller than wide within 1.6°."""
LEAST_LEAN_DEG = 1.0
"""Least lean that is reported [deg]."""
UNLIKE = 1.5
"""Least ratio of the tallest to the lowest object: else the plane could be too high for all instead."""


@dataclass(frozen=True)
class Base:
    """Base of an object in its pose: the faces of its hull that look down."""

    middle_m: float
    """Height of their middle above the support plane; negative below."""
    height_m: float
    """Height of the object above it."""
    lean_deg: tuple[float, float]
    """Horizontal part of their normal, x and y of the world frame, as an angle."""


@dataclass(frozen=True)
class MeasuredHeights:
    """Height and lean that objects of a frame are measured with in common."""

    ratio: float
    """Measured height by height of the model; below 1 poses that fit sink into the support plane."""
    lean_deg: float
    """How far most of them lean, all the same way; 0 where they do not agree in that."""
    objects: int
    """Number of objects that agree."""

    def explained_m(self, height_m: float) -> float:
        """How deep a pose that fits the depth sinks in by it, of an object of this height; negative where it floats."""
        return (1 - self.ratio) * height_m

    def describe(self) -> str:
        """Description of the fault and what to check, in two sentences."""
        percent = round(100 * abs(1 - self.ratio))
        way, put = ("short", "sink into the plane") if self.ratio < 1 else ("long", "float above the plane")
        leaning = f", and {self.lean_deg:.1f}° from upright" if self.lean_deg else ""
        return (
            f"Depth measures heights {percent} % {way}{leaning}: {self.objects} objects agree. Poses that fit it {put} "
            "by as much, which is not held against them; check depth_scale and the sensor's calibration."
        )


def measured_heights(problem: Problem, answers: Sequence[Best | None]) -> MeasuredHeights | None:
    """Estimate how high a frame's depth measures its objects, from those that are answered well.

    None where fewer than ``FEWEST``, or no more than half of those that stand on the plane, agree, or where it moves no
    pose by more than ``IMPOSSIBLE_M``.

    Args:
        problem: the frame.
        answers: the answer for each target; None where there is none.
    """
    support = problem.observation.support
    if support is None or support.surroundings is not None:
        return None
    answered = [
        base_of(target.model, best.T_cam_obj, support)
        for target, best in zip(problem.targets, answers, strict=True)
        if best is not None and best.score.score >= WELL
    ]
    return heights_in_common([one for one in answered if one is not None])


def heights_in_common(bases: Sequence[Base]) -> MeasuredHeights | None:
    """Estimate the common height and lean of bases near the plane; None as for :func:`measured_heights`."""
    near = [one for one in bases if abs(one.middle_m) < SHARE * one.height_m + IMPOSSIBLE_M]
    if len(near) < FEWEST:
        return None
    middles_m, heights_m = np.array([one.middle_m for one in near]), np.array([one.height_m for one in near])
    off_m = np.abs(middles_m - np.outer(middles_m / heights_m, heights_m))
    agreeing = max(off_m < AGREE_M, key=np.count_nonzero)
    n, middles_m, heights_m = int(np.count_nonzero(agreeing)), middles_m[agreeing], heights_m[agreeing]
    rise = float(middles_m @ heights_m / (heights_m @ heights_m))
    is_little = abs(rise) * heights_m.max() < IMPOSSIBLE_M
    if n < FEWEST or 2 * n <= len(near) or is_little or heights_m.max() < UNLIKE * heights_m.min():
        return None
    leans = np.array([one.lean_deg for one in near])[agreeing]
    lean = np.median(leans, axis=0)
    n_leaning = np.count_nonzero(np.linalg.norm(leans - lean, axis=1) < AGREE_DEG)
    lean_deg = float(np.linalg.norm(lean)) if 2 * n_leaning > n else 0.0
    return MeasuredHeights(1 + rise, lean_deg if lean_deg >= LEAST_LEAN_DEG else 0.0, n)


def base_of(model: ObjectModel, T_cam_obj: Float, support: Support) -> Base | None:
    """The base of an object; None where no face of its hull looks down, or it has no volume."""
    hull = _hull(model)
    if hull is None:
        return None
    T_world_obj = support.T_world_cam @ T_cam_obj
    normals = hull.equations[:, :3] @ T_world_obj[:3, :3].T
    down = normals @ support.normal_world <= -np.cos(np.radians(BASE_DEG))
    if not down.any():
        return None
    a, b, c = np.moveaxis(apply(T_world_obj, model.vertices)[hull.simplices[down]], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    up = areas @ -normals[down] / areas.sum()
    middle_m = float(areas @ ((a + b + c) @ support.normal_world) / (3 * areas.sum()))
    top_m = float((apply(T_world_obj, hull.points[hull.vertices]) @ support.normal_world).max())
    x, y = np.degrees((up - support.normal_world)[:2] / np.linalg.norm(up))
    return Base(middle_m, top_m - middle_m, (float(x), float(y)))


@lru_cache(maxsize=100)
def _hull(model: ObjectModel) -> ConvexHull | None:
    try:
        return ConvexHull(model.vertices)
    except QhullError:
        return None
