"""The depth image of one model in one pose, only where it shows; drawn as the official BOP toolkit draws it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.evaluation.model import EvalModel
from verefine_viz.rendering.rasterizer import draw, window


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


@njit(cache=True, nogil=True)
def _draw(T, vertices, faces, normals, offsets, closed, fx, fy, cx, cy, height, width):
    projected = np.empty((len(vertices), 3))
    x0, y0, columns, rows, n_front = window(T, vertices, fx, fy, cx, cy, height, width, projected)
    inv_z = np.zeros((rows, columns), np.float32)
    if columns > 0:
        face_of = np.empty((rows, columns), np.int32)
        draw(
            T, vertices, faces, normals, offsets, closed, projected, n_front,
            fx, fy, cx, cy, inv_z, face_of, x0, y0, 0,
        )  # fmt: skip
    for y in range(rows):
        for x in range(columns):
            if inv_z[y, x] > 0.0:
                inv_z[y, x] = np.float32(1000.0 / np.float64(inv_z[y, x]))
    return x0, y0, inv_z
