"""Mean distances (ADD, ADI) and errors of rotation and translation, in millimetres and degrees."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.model import EvalModel

ROUNDED = 1e-5
"""How far RᵀR of a rotation that was written with few digits may be from the identity."""


def add_mm(model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float) -> float:
    """Mean distance of corresponding vertices [mm] (Hinterstoisser 2012)."""
    shift = model.vertices_mm @ (R_est - R_gt).T + (t_est_mm - t_gt_mm)
    return float(np.sqrt(np.einsum("ij,ij->i", shift, shift)).mean())


def adi_mm(model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float) -> float:
    """Mean distance of true vertices to the nearest estimated one [mm]: ADI of BOP, ADD-S of others."""
    truth = model.vertices_mm @ R_gt.T + t_gt_mm
    estimated = model.vertices_mm @ R_est.T + t_est_mm
    return float(KDTree(estimated, balanced_tree=False, compact_nodes=False).query(truth)[0].mean())


def adi_by_index_mm(model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float) -> float:
    """:func:`adi_mm` for a model of which many poses are measured: about ten times as fast.

    Distances are measured in the model's frame, hence the same to the digits to which ``R_est`` is a rotation.
    """
    if np.abs(R_est.T @ R_est - np.eye(3)).max() > ROUNDED:
        return adi_mm(model, R_est, t_est_mm, R_gt, t_gt_mm)
    truth = model.vertices_mm @ R_gt.T + t_gt_mm
    return float(model.nearest.query((truth - t_est_mm) @ R_est * 1e-3)[0].mean()) * 1e3


def rotation_deg(R_est: Float, R_gt: Float) -> float:
    """Angle between two rotations [deg], as the BOP toolkit has it (good to 1e-6, also for rounded matrices)."""
    cosine = 0.5 * (float(np.trace(R_est @ np.linalg.inv(R_gt))) - 1.0)
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def symmetric_errors(
    model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float
) -> tuple[float, float]:
    """Errors of rotation [deg] and translation [mm] against that of the equivalent true poses that is turned least.

    For objects without symmetries: the angle between the rotations and the distance of the origins.
    """
    Rs, ts_mm = R_gt @ model.symmetries_mm[:, :3, :3], model.symmetries_mm[:, :3, 3] @ R_gt.T + t_gt_mm
    rest = R_est.T @ Rs
    # sin from the antisymmetric part: exact near 0, where acos loses half of its digits.
    sine = np.sqrt(
        (rest[:, 2, 1] - rest[:, 1, 2]) ** 2
        + (rest[:, 0, 2] - rest[:, 2, 0]) ** 2
        + (rest[:, 1, 0] - rest[:, 0, 1]) ** 2
    )
    angles_deg = np.rad2deg(np.arctan2(sine, np.trace(rest, axis1=1, axis2=2) - 1.0))
    k = int(np.argmin(angles_deg))
    return float(angles_deg[k]), float(np.linalg.norm(t_est_mm - ts_mm[k]))
