"""Makes an :class:`Observation` of a sensor frame, once per frame, and the observed cloud of each instance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import NoSupportError
from verefine_viz.core.observation import Observation
from verefine_viz.core.settings import SceneSettings
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.observation.support_plane import find_support

NEAREST_M = 1e-4
"""Smaller depth counts as not measured: no camera measures it, and it has no usable normals [m]."""


def observe(
    camera: Camera,
    depth_m: NDArray[np.floating],
    rgb: NDArray[np.uint8] | None,
    masks: Sequence[Mask],
    settings: SceneSettings,
    R_world_cam: Float | None = None,
    T_map_cam: Float | None = None,
) -> Observation:
    """The normals, union of the masks, support plane and gravity of one frame.

    A frame without a plane is no error: its ``support`` is None and ``support_note`` gives the reason.

    Args:
        camera: intrinsics.
        depth_m: z, (H, W) [m]; 0 where nothing was measured.
        rgb: (H, W, 3), or None.
        masks: (H, W) of every instance in the frame.
        settings: where gravity comes from, and the seed.
        R_world_cam: (3, 3) camera to world, world z up, where the data set gives it.
        T_map_cam: (4, 4) camera to the data set's world [m], where the data set gives it.
    """
    object_mask = np.zeros(camera.shape, dtype=bool)
    for mask in masks:
        object_mask |= mask
    depth_m = np.where(depth_m < NEAREST_M, 0, depth_m)
    note = ""
    try:
        support = find_support(depth_m, camera, object_mask, settings.gravity, R_world_cam, settings.seed)
    except NoSupportError as error:
        support, note = None, str(error)
    depth = np.ascontiguousarray(depth_m, dtype=np.float32)
    return Observation(camera, depth, estimate_normals(depth, camera), rgb, object_mask, support, note, T_map_cam)


def segment_cloud(depth_m: NDArray[np.floating], camera: Camera, mask: Mask, n_points: int, seed: int) -> Float:
    """Points (N, 3) [m] in the camera frame of the mask's valid pixels, at most ``n_points`` of them.

    The subset is drawn without replacement and stays in reading order; it depends on the arguments only. Empty (0, 3)
    where the mask holds no depth.

    Args:
        depth_m: z, (H, W) [m]; 0 where nothing was measured.
        camera: intrinsics of the depth image.
        mask: (H, W) the instance's pixels.
        n_points: most points to return.
        seed: of the subset.
    """
    v, u = np.nonzero(np.asarray(mask, dtype=bool) & (depth_m > 0))
    if len(v) > n_points:
        chosen = np.sort(np.random.default_rng(seed).choice(len(v), size=n_points, replace=False))
        v, u = v[chosen], u[chosen]
    z = np.asarray(depth_m[v, u], dtype=np.float64)
    return np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)
