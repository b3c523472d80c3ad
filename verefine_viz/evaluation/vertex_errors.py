"""Errors of a pose over all vertices of a model [mm, deg]: ADD, ADI, MSSD, MSPD, rotation and translation.

MSSD and MSPD are exact. For each symmetry a few vertices far apart bound the largest distance from below; symmetries
are taken in the order of their bounds, and each only until it is known to be no better than the best so far. MSSD's
maximum lies on the convex hull (a distance under a linear map is convex); that is not so for MSPD.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.evaluation.bop_model import N_PROBES, EvalModel

ROUNDED = 1e-5
"""How far RᵀR of a rotation that was written with few digits may be from the identity."""


def add_mm(model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float) -> float:
    """Mean distance of corresponding vertices [mm] (Hinterstoisser 2012)."""
    shift = model.vertices_mm @ (R_est - R_gt).T + (t_est_mm - t_gt_mm)
    return float(np.sqrt(np.einsum("ij,ij->i", shift, shift)).mean())


def adi_mm(model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float) -> float:
    """Mean distance of true vertices to the nearest estimated one [mm]: ADI of BOP, ADD-S of others."""
    true_vertices = model.vertices_mm @ R_gt.T + t_gt_mm
    estimated = model.vertices_mm @ R_est.T + t_est_mm
    return float(KDTree(estimated, balanced_tree=False, compact_nodes=False).query(true_vertices)[0].mean())


def adi_by_index_mm(model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float) -> float:
    """:func:`adi_mm` for a model of which many poses are measured: about ten times as fast.

    Distances are measured in the model's frame, hence the same to the digits to which ``R_est`` is a rotation.
    """
    if np.abs(R_est.T @ R_est - np.eye(3)).max() > ROUNDED:
        return adi_mm(model, R_est, t_est_mm, R_gt, t_gt_mm)
    true_vertices = model.vertices_mm @ R_gt.T + t_gt_mm
    return float(model.nearest.query((true_vertices - t_est_mm) @ R_est * 1e-3)[0].mean()) * 1e3


def symmetric_errors(
    model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float
) -> tuple[float, float]:
    """Errors of rotation [deg] and translation [mm] against the equivalent ground-truth pose turned least.

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


def mssd_mm(model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float) -> float:
    """Maximum symmetry-aware surface distance [mm]; infinite for a pose that is not finite.

    Args:
        model: its vertices and symmetries.
        R_est: (3, 3), used as it is.
        t_est_mm: (3,) [mm].
        R_gt: (3, 3) true rotation.
        t_gt_mm: (3,) [mm].

    Source: BOP challenge 2019.
    """
    points, n_hull = model.sorted_vertices
    pose = np.column_stack([R_est, t_est_mm]), np.column_stack([R_gt, t_gt_mm])
    return float(_mssd(*pose, model.symmetries_mm, points[:n_hull], min(N_PROBES, n_hull)))


def mspd_px(model: EvalModel, R_est: Float, t_est_mm: Float, R_gt: Float, t_gt_mm: Float, K: Float) -> float:
    """Maximum symmetry-aware projection distance [px of the image]; infinite where a vertex has no projection.

    Nothing is tested for visibility or for being in front of the camera.

    Args:
        model: its vertices and symmetries.
        R_est: (3, 3), used as it is.
        t_est_mm: (3,) [mm].
        R_gt: (3, 3) true rotation.
        t_gt_mm: (3,) [mm].
        K: (3, 3) camera matrix [px].

    Source: BOP challenge 2019, where it is multiplied by 640 / image width before it is compared with thresholds.
    """
    points, n_hull = model.sorted_vertices
    with np.errstate(invalid="ignore", over="ignore"):  # a pose may hold infinity
        pose = K @ np.column_stack([R_est, t_est_mm]), K @ np.column_stack([R_gt, t_gt_mm])
    return float(_mspd(*pose, model.symmetries_mm, points, min(N_PROBES, n_hull)))


@kernel(nogil=True)
def _mssd(P_est, P_gt, symmetries, points, n_probes):
    n = len(symmetries)
    maps, bounds = np.empty((n, 3, 4)), np.empty(n)
    for k in range(n):
        for i in range(3):
            for j in range(4):
                s = P_gt[i, 3] if j == 3 else 0.0
                for m in range(3):
                    s += P_gt[i, m] * symmetries[k, m, j]
                maps[k, i, j] = P_est[i, j] - s
        bounds[k] = _largest_shift(maps[k], points, 0, n_probes, 0.0, np.inf)
    best = np.inf
    for k in np.argsort(bounds):
        if not bounds[k] < best:
            break
        best = min(best, _largest_shift(maps[k], points, n_probes, len(points), bounds[k], best))
    return np.sqrt(best)


@kernel(nogil=True)
def _largest_shift(A, points, first, last, least, limit):
    """Largest |A·(x, 1)|² of some points, at least ``least``; a value ≥ ``limit`` as soon as that is reached."""
    largest = least
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        dx = A[0, 0] * x + A[0, 1] * y + A[0, 2] * z + A[0, 3]
        dy = A[1, 0] * x + A[1, 1] * y + A[1, 2] * z + A[1, 3]
        dz = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z + A[2, 3]
        squared = dx * dx + dy * dy + dz * dz
        if not squared < np.inf:
            return np.inf
        if squared > largest:
            largest = squared
            if largest >= limit:
                break
    return largest


@kernel(nogil=True)
def _mspd(P_est, P_gt, symmetries, points, n_probes):
    n = len(symmetries)
    maps, bounds = np.empty((n, 3, 4)), np.empty(n)
    seen = np.empty((len(points), 2))
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        w = P_est[2, 0] * x + P_est[2, 1] * y + P_est[2, 2] * z + P_est[2, 3]
        if w == 0.0:
            return np.inf
        seen[i, 0] = (P_est[0, 0] * x + P_est[0, 1] * y + P_est[0, 2] * z + P_est[0, 3]) / w
        seen[i, 1] = (P_est[1, 0] * x + P_est[1, 1] * y + P_est[1, 2] * z + P_est[1, 3]) / w
    for k in range(n):
        for i in range(3):
            for j in range(4):
                s = P_gt[i, 3] if j == 3 else 0.0
                for m in range(3):
                    s += P_gt[i, m] * symmetries[k, m, j]
                maps[k, i, j] = s
        bounds[k] = _largest_miss(maps[k], points, seen, 0, n_probes, 0.0, np.inf)
    best = np.inf
    for k in np.argsort(bounds):
        if not bounds[k] < best:
            break
        best = min(best, _largest_miss(maps[k], points, seen, n_probes, len(points), bounds[k], best))
    return np.sqrt(best)


@kernel(nogil=True)
def _largest_miss(P, points, seen, first, last, least, limit):
    """Largest squared distance of the projections of some points by P from where they are ``seen``; see above."""
    largest = least
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        w = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
        if w == 0.0:
            return np.inf
        du = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / w - seen[i, 0]
        dv = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / w - seen[i, 1]
        squared = du * du + dv * dv
        if not squared < np.inf:
            return np.inf
        if squared > largest:
            largest = squared
            if largest >= limit:
                break
    return largest
