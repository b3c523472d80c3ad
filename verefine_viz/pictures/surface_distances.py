"""How far observed points lie outside or inside of posed models: colours of the cloud, numbers of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target

REACH = 3
"""Points further from a model than this many depth tolerances have no distance to it."""


def signed_distances(points_cam: NDArray[np.floating], posed: Sequence[tuple[Target, Float]], reach_m: float) -> Float:
    """Return by how much points (N, 3) lie outside of the nearest model, (N,) [m]: negative inside, NaN out of reach.

    The distance is that to the tangent plane at the nearest of the points sampled on a model.
    """
    nearest_m, signed_m = np.full(len(points_cam), reach_m), np.full(len(points_cam), np.nan)
    for target, T_cam_obj in posed:
        points = apply(inverse(T_cam_obj), np.asarray(points_cam, float))
        low, high = target.model.points.min(axis=0) - reach_m, target.model.points.max(axis=0) + reach_m
        around = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
        near_m, index = _tree(target.model).query(points[around], distance_upper_bound=reach_m)
        distances_m, which = np.asarray(near_m), np.asarray(index)
        closer = distances_m < nearest_m[around]
        around, which = around[closer], which[closer]
        nearest_m[around] = distances_m[closer]
        offsets = points[around] - target.model.points[which]
        signed_m[around] = np.einsum("ij,ij->i", offsets, target.model.point_normals[which])
    return signed_m


def point_distance(point_cam: Float, target: Target, T_cam_obj: Float, tau_m: float) -> float:
    """Return by how much one point (3,) lies outside of a model [m]; NaN further away than colours reach."""
    return float(signed_distances(point_cam[None], [(target, T_cam_obj)], REACH * tau_m)[0])


@lru_cache(maxsize=64)
def _tree(model: ObjectModel) -> KDTree:
    return KDTree(model.points)
