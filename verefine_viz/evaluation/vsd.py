"""Visible surface discrepancy (Hodan 2018): where the visible surfaces of two poses differ, as a share of their union.

Every number is as the official BOP toolkit has it, bit for bit: distances along the ray in double precision, visibility
in single precision, costs counted where the distance is at least τ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.kernels import kernel
from verefine_viz.evaluation.bop_model import EvalModel
from verefine_viz.rendering.rasterizer import draw, window

# The depth image of one model in one pose, only where it shows; drawn as the official BOP toolkit draws it.


class DepthPatch(NamedTuple):
    """A part of a depth image; everything outside is empty."""

    x0: int
    """First column [px]."""
    y0: int
    """First row [px]."""
    depth_mm: NDArray[np.float32]
    """(rows, columns) z [mm]; 0 = empty."""


EMPTY = DepthPatch(0, 0, np.zeros((0, 0), np.float32))


def model_depth(model: EvalModel, R: Float, t_mm: Float, K: Float, shape: tuple[int, int]) -> DepthPatch:
    """The model's depth in a pose.

    Rays go through (u + 0.5, v + 0.5), as OpenGL places pixel centres. A model whose box reaches the camera plane is
    not drawn, nor one whose box is flat and faces the camera: the toolkit takes near and far plane from the box.

    Args:
        model: what to draw.
        R: (3, 3), used as it is, also where it is no exact rotation.
        t_mm: (3,) [mm].
        K: (3, 3) camera matrix [px]; a skew is ignored. Whatever it holds, nothing is drawn outside of the image.
        shape: (height, width) of the image [px].
    """
    z_mm = model.corners_mm @ R[2] + t_mm[2]
    near_mm, far_mm = z_mm.min(), z_mm.max()
    if not 0.0 < near_mm < far_mm < np.inf:
        return EMPTY
    T_cam_obj = np.eye(4)
    T_cam_obj[:3, :3], T_cam_obj[:3, 3] = R, t_mm * 1e-3
    fx, fy, cx, cy = float(K[0, 0]), float(K[1, 1]), float(K[0, 2]) - 0.5, float(K[1, 2]) - 0.5
    x0, y0, depth_mm = _draw(T_cam_obj, *model.mesh.arrays, fx, fy, cx, cy, *shape)
    return DepthPatch(x0, y0, depth_mm)


@kernel(nogil=True)
def _draw(T, vertices, faces, normals, offsets, closed, fx, fy, cx, cy, height, width):
    projected = np.empty((len(vertices), 3))
    x0, y0, columns, rows, n_front = window(T, vertices, fx, fy, cx, cy, height, width, projected)
    inv_z = np.zeros((rows, columns), np.float32)
    if columns > 0:
        face_of = np.empty((rows, columns), np.int32)
        draw(
            T, vertices, faces, normals, offsets, closed, projected, n_front,
            fx, fy, cx, cy, inv_z, face_of, x0, y0, np.int64(0),
        )  # fmt: skip
    for y in range(rows):
        for x in range(columns):
            if inv_z[y, x] > 0.0:
                inv_z[y, x] = np.float32(1000.0 / np.float64(inv_z[y, x]))
    return x0, y0, inv_z


TAUS = np.arange(0.05, 0.51, 0.05)
"""Misalignment tolerances τ as shares of the diameter; 3 and 7 are a hair above 0.15 and 0.35."""

DELTA_MM = 15.0
"""A surface is visible up to this far behind the measured one [mm]."""

DELTA_MM_ITODD = 5.0
"""Tolerance of visibility for the ITODD data set [mm]."""


def vsd(
    depth_mm: NDArray[np.float32],
    estimate: DepthPatch,
    gt: DepthPatch,
    K: Float,
    diameter_mm: float,
    delta_mm: float = DELTA_MM,
    taus: Float = TAUS,
) -> Float:
    """Errors (len(taus),) in [0, 1] of an estimate against ground truth.

    Args:
        depth_mm: the measured image (H, W) [mm]; 0 where nothing was measured, which counts as visible.
        estimate: the model drawn in the estimated pose.
        gt: the model drawn at ground truth.
        K: (3, 3) camera matrix [px]; a skew is ignored.
        diameter_mm: what ``taus`` are shares of [mm].
        delta_mm: see :data:`DELTA_MM`.
        taus: ascending.

    Source: Hodan et al., BOP challenge 2019; the toolkit's visibility mode "bop19" and cost "step".
    """
    costs = np.zeros(len(taus), np.int64)
    n_common, n_union = _compare(
        depth_mm, gt.depth_mm, gt.x0, gt.y0, estimate.depth_mm, estimate.x0, estimate.y0,
        K[0, 0], K[1, 1], K[0, 2], K[1, 2], np.float32(delta_mm), float(diameter_mm), taus, costs,
    )  # fmt: skip
    if n_union == 0:
        return np.ones(len(taus))
    return (costs + (n_union - n_common)) / float(n_union)


def spheres_overlap_in_image(t_est_mm: Float, t_gt_mm: Float, diameter_mm: float) -> bool:
    """Whether balls around the two origins overlap in the image, as the toolkit estimates it; if not, VSD is 1."""
    if t_est_mm[2] == 0 or t_gt_mm[2] == 0:
        return False
    apart = np.linalg.norm(t_est_mm[:2] / t_est_mm[2] - t_gt_mm[:2] / t_gt_mm[2])
    return bool(apart < 0.5 * diameter_mm * (1.0 / t_est_mm[2] + 1.0 / t_gt_mm[2]))


def seen(
    depth_mm: NDArray[np.float32], drawn_mm: NDArray[np.float32], K: Float, delta_mm: float = DELTA_MM
) -> NDArray[np.bool_]:
    """The pixels (H, W) in which a drawn surface is visible by the toolkit's mode "bop19": at most ``delta_mm`` behind
    the measured one, or where nothing was measured.

    Args:
        depth_mm: the measured image (H, W) [mm]; 0 where nothing was measured.
        drawn_mm: the drawn one (H, W) [mm]; 0 where there is nothing.
        K: (3, 3) camera matrix [px]; a skew is ignored.
        delta_mm: see :data:`DELTA_MM`.
    """
    is_seen = np.zeros(depth_mm.shape, np.bool_)
    _see(depth_mm, drawn_mm, K[0, 0], K[1, 1], K[0, 2], K[1, 2], np.float32(delta_mm), is_seen)
    return is_seen


@kernel()
def _distance(u, v, z):
    """Along the ray (u, v, 1) to depth z."""
    return np.sqrt((u * z) ** 2 + (v * z) ** 2 + z**2)


@kernel()
def _is_seen(drawn, measured, delta):
    return drawn > 0.0 and (measured == 0.0 or np.float32(drawn) - np.float32(measured) <= delta)


@kernel(nogil=True)
def _see(depth, drawn, fx, fy, cx, cy, delta, is_seen):
    for y in range(depth.shape[0]):
        for x in range(depth.shape[1]):
            u, v = (x - cx) / fx, (y - cy) / fy
            measured = _distance(u, v, np.float64(depth[y, x]))
            is_seen[y, x] = _is_seen(_distance(u, v, np.float64(drawn[y, x])), measured, delta)


@kernel(nogil=True)
def _compare(depth, gt, x_gt, y_gt, estimate, x_est, y_est, fx, fy, cx, cy, delta, diameter, taus, costs):
    """Counts the visible pixels that both surfaces have and those that either has; adds to ``costs`` for each τ."""
    rows_gt, columns_gt = gt.shape
    rows_est, columns_est = estimate.shape
    y_first, y_last = min(y_gt, y_est), max(y_gt + rows_gt, y_est + rows_est)
    x_first, x_last = min(x_gt, x_est), max(x_gt + columns_gt, x_est + columns_est)
    if rows_gt == 0 or columns_gt == 0:
        y_first, y_last, x_first, x_last = y_est, y_est + rows_est, x_est, x_est + columns_est
    elif rows_est == 0 or columns_est == 0:
        y_first, y_last, x_first, x_last = y_gt, y_gt + rows_gt, x_gt, x_gt + columns_gt
    n_common, n_union = 0, 0
    for y in range(y_first, y_last):
        in_gt = y_gt <= y < y_gt + rows_gt
        in_est = y_est <= y < y_est + rows_est
        for x in range(x_first, x_last):
            z_gt, z_est = np.float64(0.0), np.float64(0.0)
            if in_gt and x_gt <= x < x_gt + columns_gt:
                z_gt = np.float64(gt[y - y_gt, x - x_gt])
            if in_est and x_est <= x < x_est + columns_est:
                z_est = np.float64(estimate[y - y_est, x - x_est])
            if z_gt == 0.0 and z_est == 0.0:
                continue
            u, v = (x - cx) / fx, (y - cy) / fy
            d = _distance(u, v, np.float64(depth[y, x]))
            d_gt = _distance(u, v, z_gt)
            d_est = _distance(u, v, z_est)
            seen_gt = _is_seen(d_gt, d, delta)
            seen_est = _is_seen(d_est, d, delta) or (seen_gt and d_est > 0.0)
            if seen_gt or seen_est:
                n_union += 1
            if seen_gt and seen_est:
                n_common += 1
                far = abs(d_gt - d_est) / diameter
                for k in range(len(taus)):
                    if not far >= taus[k]:
                        break
                    costs[k] += 1
    return n_common, n_union
