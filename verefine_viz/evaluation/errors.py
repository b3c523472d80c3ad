"""Errors of an estimated pose against ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel


@dataclass(frozen=True)
class PoseErrors:
    """How far an estimate is from ground truth."""

    rotation_deg: float
    """Angle to the nearest of the poses that look the same [deg]."""
    translation_mm: float
    """Distance of the object's origin [mm]."""
    add_mm: float
    """Mean distance of corresponding model points [mm] (Hinterstoisser 2012)."""
    adds_mm: float
    """Mean distance of ground-truth points to the nearest estimated point [mm] (Xiang 2018)."""
    add_s_mm: float
    """ADD-S for symmetric objects, ADD for the others [mm]: the usual ADD(-S)."""
    relative: float
    """ADD(-S) as a share of the diameter; below 0.1 counts as correct."""


def pose_errors(model: ObjectModel, T_est: Float, T_gt: Float) -> PoseErrors:
    """Errors of ``T_est`` (4, 4) against ``T_gt`` (4, 4), measured on the model's sampled points."""
    estimated, truth = apply(T_est, model.points), apply(T_gt, model.points)
    add = float(np.linalg.norm(estimated - truth, axis=1).mean()) * 1e3
    adds = float(KDTree(estimated).query(truth)[0].mean()) * 1e3
    add_s = adds if model.is_symmetric else add
    return PoseErrors(
        rotation_error_deg(model, T_est, T_gt),
        float(np.linalg.norm(T_est[:3, 3] - T_gt[:3, 3])) * 1e3,
        add,
        adds,
        add_s,
        add_s / (model.diameter_m * 1e3),
    )


def rotation_error_deg(model: ObjectModel, T_est: Float, T_gt: Float) -> float:
    """Smallest angle [deg] between the estimate and ground truth turned by any of the model's symmetries."""
    R_rest = T_est[:3, :3].T @ T_gt[:3, :3] @ model.symmetries[:, :3, :3]
    # sin from the antisymmetric part: exact near 0, where acos loses half of its digits.
    sine = np.linalg.norm(
        [R_rest[:, 2, 1] - R_rest[:, 1, 2], R_rest[:, 0, 2] - R_rest[:, 2, 0], R_rest[:, 1, 0] - R_rest[:, 0, 1]],
        axis=0,
    )
    cosine = np.trace(R_rest, axis1=1, axis2=2) - 1
    return float(np.rad2deg(np.arctan2(sine, cosine)).min())
