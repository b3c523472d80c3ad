"""The observed cloud of one instance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera


def segment_cloud(depth_m: NDArray[np.floating], camera: Camera, mask: Mask, n_points: int, seed: int) -> Float:
    """Points (N, 3) [m] in the camera frame of the mask's valid pixels, at most ``n_points`` of them.

    The subset is drawn without replacement and kept in reading order; it depends on the arguments only. Empty (0, 3)
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
