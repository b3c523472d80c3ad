"""Input of ``depth_net`` for an object at a pose, and the meaning of its answer. docs/methods.md 4.4.

A crop is the image of a virtual camera that stands at the real one and looks at the object's centre, with a field of
view that follows the object's size and distance. In it every object at every place looks alike: centred, of one
size, depth counted from its centre in units of its radius. The answer is a step in that camera's frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, writable
from verefine_viz.core.camera import Camera
from verefine_viz.core.kernels import kernel
from verefine_viz.rendering.mesh import RenderMesh
from verefine_viz.rendering.rasterizer import draw_depth

FORMAT = 1
"""Format of crops and answers; weights of another format are refused."""
SIDE_PX = 40
"""Side of a crop [px]."""
REACH = 1.5
"""Half of what a crop shows, at the object's centre, in radii."""
DEEPEST = 1.5
"""Distance from the object's centre to which depth is clamped, in radii."""
FINE = 0.25
"""Difference of depths at which its channel is clamped, in radii, so that small differences are large numbers."""
CHANNELS = ("observed", "rendered", "difference", "own", "drawn", "measured")
"""Channels of a crop: depth of the frame and of the model, in radii from the object's centre; their difference, in
units of ``FINE``, where both are the object's; whether a pixel is measured and in the mask, is drawn, is measured."""
NEAREST_RADII = 1.2
"""Distance of an object's centre from the camera, in radii, below which it is not refined: the camera is inside."""
ANSWERS = 7
"""Numbers of an answer: rotation vector [rad] and shift [radii] in the crop's frame, log of the error left [radii]."""


@dataclass(frozen=True, eq=False)
class Extent:
    """Middle and size of a model."""

    centre_obj: Float
    """(3,) middle of its bounding box, in its own frame [m]."""
    radius_m: float
    """Half of its diameter [m]."""


def extent_of(vertices: Float, diameter_m: float) -> Extent:
    """The extent of a mesh with vertices (V, 3) [m]."""
    return Extent((vertices.min(axis=0) + vertices.max(axis=0)) / 2, diameter_m / 2)


@dataclass(frozen=True, eq=False)
class DepthCrops:
    """Crops of N poses of one object, as the network sees them."""

    channels: NDArray[np.float32]
    """(N, C, S, S), ``CHANNELS``."""
    Rs_crop_cam: Float
    """(N, 3, 3) the virtual cameras."""
    is_usable: NDArray[np.bool_]
    """(N,) whether the crop shows something of the object's mask and of its model."""


def crops_at(
    depth_m: NDArray[np.float32],
    mask: NDArray[np.bool_],
    camera: Camera,
    mesh: RenderMesh,
    extent: Extent,
    Ts_cam_obj: Float,
) -> DepthCrops:
    """The crops of N poses (N, 4, 4) of one object.

    Args:
        depth_m: (H, W) observed z [m], 0 where nothing was measured.
        mask: (H, W) the object's pixels.
        camera: intrinsics of both.
        mesh: what is drawn.
        extent: of the model.
        Ts_cam_obj: the poses [m].
    """
    n = len(Ts_cam_obj)
    channels = np.zeros((n, len(CHANNELS), SIDE_PX, SIDE_PX), np.float32)
    Rs_crop_cam, is_usable = np.empty((n, 3, 3)), np.zeros(n, np.bool_)
    pinhole = camera.fx, camera.fy, camera.cx, camera.cy
    depth_m, mask = _read_only(depth_m), _read_only(mask)
    for k in range(n):
        T, drawn = writable(Ts_cam_obj[k]), mesh.arrays
        is_usable[k] = fill_crop(
            depth_m, mask, *pinhole, *drawn, extent.centre_obj, extent.radius_m, T, channels[k], Rs_crop_cam[k]
        )
    return DepthCrops(channels, Rs_crop_cam, is_usable)


def _read_only(array: NDArray) -> NDArray:
    """A view as a frame's arrays are: to numba others are of another type, for which it compiles everything again."""
    view = array.view()
    view.flags.writeable = False
    return view


@kernel(nogil=True)
def fill_crop(
    depth_m,
    mask,
    fx,
    fy,
    cx,
    cy,
    vertices,
    faces,
    normals,
    offsets,
    closed,
    centre_obj,
    radius_m,
    T,
    channels,
    R_crop_cam,
):
    """Fill one crop (C, S, S) of zeros and its camera's rotation (3, 3); return whether object and model show in it."""
    x = T[0, 0] * centre_obj[0] + T[0, 1] * centre_obj[1] + T[0, 2] * centre_obj[2] + T[0, 3]
    y = T[1, 0] * centre_obj[0] + T[1, 1] * centre_obj[1] + T[1, 2] * centre_obj[2] + T[1, 3]
    z = T[2, 0] * centre_obj[0] + T[2, 1] * centre_obj[1] + T[2, 2] * centre_obj[2] + T[2, 3]
    away_m = np.sqrt(x * x + y * y + z * z)
    if away_m == 0.0:
        look_at(0.0, 0.0, 1.0, R_crop_cam)
        return False
    look_at(x / away_m, y / away_m, z / away_m, R_crop_cam)
    if not (z > 0.0 and away_m > NEAREST_RADII * radius_m):
        return False
    height, width = depth_m.shape
    middle = (SIDE_PX - 1) / 2.0
    focal = SIDE_PX * away_m / (2.0 * REACH * radius_m)
    n_own = 0
    for row in range(SIDE_PX):
        for column in range(SIDE_PX):
            a, b = (column - middle) / focal, (row - middle) / focal
            # The ray of the crop's pixel in the camera's frame.
            rx = R_crop_cam[0, 0] * a + R_crop_cam[1, 0] * b + R_crop_cam[2, 0]
            ry = R_crop_cam[0, 1] * a + R_crop_cam[1, 1] * b + R_crop_cam[2, 1]
            rz = R_crop_cam[0, 2] * a + R_crop_cam[1, 2] * b + R_crop_cam[2, 2]
            if rz <= 0.0:
                continue
            u, v = fx * rx / rz + cx, fy * ry / rz + cy
            if not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
                continue
            i, j = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
            d = np.float64(depth_m[j, i])
            if not (d > 0.0 and d < np.inf):
                continue
            px, py = (i - cx) / fx * d, (j - cy) / fy * d
            deep = (R_crop_cam[2, 0] * px + R_crop_cam[2, 1] * py + R_crop_cam[2, 2] * d - away_m) / radius_m
            channels[0, row, column] = min(max(deep, -DEEPEST), DEEPEST)
            channels[5, row, column] = 1.0
            if mask[j, i]:
                channels[3, row, column] = 1.0
                n_own += 1
    T_crop = np.zeros((4, 4))
    for i in range(3):
        for j in range(4):
            T_crop[i, j] = R_crop_cam[i, 0] * T[0, j] + R_crop_cam[i, 1] * T[1, j] + R_crop_cam[i, 2] * T[2, j]
    T_crop[3, 3] = 1.0
    drawn_m = np.zeros((SIDE_PX, SIDE_PX), np.float32)
    draw_depth(T_crop, vertices, faces, normals, offsets, closed, focal, focal, middle, middle, drawn_m)
    n_drawn = 0
    for row in range(SIDE_PX):
        for column in range(SIDE_PX):
            if drawn_m[row, column] > 0.0:
                n_drawn += 1
                deep = (np.float64(drawn_m[row, column]) - away_m) / radius_m
                channels[1, row, column] = min(max(deep, -DEEPEST), DEEPEST)
                channels[4, row, column] = 1.0
                if channels[3, row, column] > 0.0:
                    gap = (np.float64(channels[0, row, column]) - deep) / FINE
                    channels[2, row, column] = min(max(gap, -1.0), 1.0)
    return n_own > 0 and n_drawn > 0


@kernel()
def look_at(x, y, z, R):
    """Fills R (3, 3) with the smallest rotation that turns the direction (x, y, z) into the z axis."""
    # v = d × e_z, c = d · e_z;  R = I + [v] + [v]² / (1 + c); where d is −z there is no smallest one.
    c = max(z, -0.999999)
    k = 1.0 / (1.0 + c)
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - x * x * k, -x * y * k, -x
    R[1, 0], R[1, 1], R[1, 2] = -x * y * k, 1.0 - y * y * k, -y
    R[2, 0], R[2, 1], R[2, 2] = x, y, z


def moved_by(T_cam_obj: Float, step: Float, R_crop_cam: Float, extent: Extent) -> Float:
    """The pose (4, 4) [m] after a step: rotation vector [rad] and shift [radii] in the crop's frame, (6,)."""
    R = R_crop_cam.T @ rotation_by(step[:3]) @ R_crop_cam @ T_cam_obj[:3, :3]
    centre_cam = T_cam_obj[:3, :3] @ extent.centre_obj + T_cam_obj[:3, 3]
    out = np.eye(4)
    out[:3, :3] = R
    out[:3, 3] = centre_cam + extent.radius_m * (R_crop_cam.T @ step[3:6]) - R @ extent.centre_obj
    return out


def rotation_by(vector: Float) -> Float:
    """The rotation (3, 3) of a rotation vector (3,) [rad], exact near 0 as well."""
    angle = float(np.sqrt(vector @ vector))
    x, y, z = vector
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-6:
        return np.eye(3) + K + K @ K / 2
    return np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * (K @ K)
