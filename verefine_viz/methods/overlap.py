"""LCP, the largest common pointset: how much of a model its segment explains at a pose. docs/methods.md 3.2.

Computed over all points; the library of the published system stops counting once the best pose so far is out of reach,
so that its numbers for all other poses are too low.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.problem import Target

DELTA_M = 0.005
"""A model point nearer than this to a point of the segment is explained [m]."""


def overlaps(target: Target, Ts_cam_obj: Float) -> Float:
    """Share (N,) of the model's points that lie within ``DELTA_M`` of the segment, at poses (N, 4, 4), in [0, 1].

    Seen from one side, even the true pose stays well below 1.
    """
    points, segment = target.model.points, target.instance.points_cam
    if len(points) == 0 or len(segment) == 0:
        return np.zeros(len(Ts_cam_obj))
    tree = KDTree(segment)
    moved = np.concatenate([apply(T, points) for T in Ts_cam_obj])
    distance_m = tree.query(moved, distance_upper_bound=DELTA_M)[0]
    return np.isfinite(distance_m).reshape(len(Ts_cam_obj), len(points)).mean(axis=1)
