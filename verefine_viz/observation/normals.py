"""Surface normals of a depth image.

A plane is linear in inverse depth: ``n · X = d`` with ``X = z (x, y, 1)`` gives ``1/z = (n_x x + n_y y + n_z) / d`` on
the normalised image plane, so the normal is the gradient of ``1/z`` there, and a least-squares fit of ``1/z`` is exact
on tilted planes whatever the window. The fit is separable: slopes along rows first, then those of the rows along
columns, each from running sums, so its cost does not grow with the window. docs/methods.md 1.8.5 has what goes wrong
otherwise.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.camera import Camera

WINDOW_M = 0.008
"""Half-width of the fitted window on a surface that faces the camera [m]."""
MIN_WINDOW_PX = 2
"""Smallest half-width [px]: three samples are the least a slope can be checked with."""
MAX_WINDOW_PX = 12
"""Largest half-width [px]: where the camera is very near."""
JUMP_M = 0.006
"""Step between neighbouring pixels that ends a surface, up to 1 m away [m]; grows with z² beyond, as noise does."""


def estimate_normals(depth_m: NDArray[np.floating], camera: Camera, window_m: float = WINDOW_M) -> NDArray[np.float32]:
    """Unit normals towards the camera, (H, W, 3) in the camera frame; 0 where none could be estimated.

    A window is metric (``window_m`` to each side, so fewer pixels far away), stops at depth jumps and at pixels without
    depth, and may lie to one side of its pixel there.

    Args:
        depth_m: z, (H, W) [m]; 0 where nothing was measured.
        camera: intrinsics of the depth image.
        window_m: half-width of the window [m]; larger is smoother and rounds edges more.
    """
    depth = np.ascontiguousarray(depth_m, dtype=np.float64)
    return _normals(depth, camera.fx, camera.fy, camera.cx, camera.cy, window_m)


@njit(cache=True)
def _is_jump(z: float, z_next: float) -> bool:
    nearer = min(z, z_next)
    return not (z > 0.0 and z_next > 0.0) or abs(z - z_next) > JUMP_M * max(1.0, nearer * nearer)


@njit(cache=True)
def _half_window(z: float, focal_px: float, window_m: float) -> int:
    # Clamped before it becomes a whole number, which a camera of any focal length must.
    return round(min(max(MIN_WINDOW_PX, window_m * focal_px / z), MAX_WINDOW_PX))


@njit(cache=True)
def _fit_rows(depth: np.ndarray, fx: float, window_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Per pixel, from a line through ``1/z`` along the row: its slope per pixel, its value here, the slope's weight."""
    h, w = depth.shape
    slope = np.zeros((h, w))
    value = np.zeros((h, w))
    weight = np.zeros((h, w))
    total = np.zeros(w + 1)
    moment = np.zeros(w + 1)
    last = np.zeros(w, dtype=np.int64)
    for v in range(h):
        end = w - 1
        for u in range(w - 1, -1, -1):  # last[u]: the last pixel of the run of surface that u belongs to
            if u == w - 1 or _is_jump(depth[v, u], depth[v, u + 1]):
                end = u
            last[u] = end
        first = 0
        for u in range(w):
            q = 1.0 / depth[v, u] if depth[v, u] > 0.0 else 0.0
            total[u + 1] = total[u] + q
            moment[u + 1] = moment[u] + q * u
        for u in range(w):
            z = depth[v, u]
            if u > 0 and _is_jump(depth[v, u - 1], z):
                first = u
            if z <= 0.0:
                continue
            r = _half_window(z, fx, window_m)
            a = max(u - r, first)
            b = min(u + r, last[u])
            n = b - a + 1
            centre = 0.5 * (a + b)
            s = total[b + 1] - total[a]
            if n < 3:
                value[v, u] = 1.0 / z
                continue
            spread = n * (n * n - 1) / 12.0
            slope[v, u] = (moment[b + 1] - moment[a] - centre * s) / spread
            value[v, u] = s / n + slope[v, u] * (u - centre)
            weight[v, u] = spread
    return slope, value, weight


@njit(cache=True)
def _normals(depth: np.ndarray, fx: float, fy: float, cx: float, cy: float, window_m: float) -> np.ndarray:
    h, w = depth.shape
    slope_u, value, weight = _fit_rows(depth, fx, window_m)
    # Running sums down the columns, stored row by row so that memory is read in order.
    total = np.zeros((h + 1, w))
    moment = np.zeros((h + 1, w))
    slopes = np.zeros((h + 1, w))
    weights = np.zeros((h + 1, w))
    last = np.zeros((h, w), dtype=np.int32)
    for v in range(h - 1, -1, -1):
        for u in range(w):
            ends = v == h - 1 or _is_jump(depth[v, u], depth[v + 1, u])
            last[v, u] = v if ends else last[v + 1, u]
    for v in range(h):
        for u in range(w):
            total[v + 1, u] = total[v, u] + value[v, u]
            moment[v + 1, u] = moment[v, u] + value[v, u] * v
            slopes[v + 1, u] = slopes[v, u] + slope_u[v, u] * weight[v, u]
            weights[v + 1, u] = weights[v, u] + weight[v, u]
    out = np.zeros((h, w, 3), dtype=np.float32)
    first = np.zeros(w, dtype=np.int64)
    for v in range(h):
        for u in range(w):
            z = depth[v, u]
            if v > 0 and _is_jump(depth[v - 1, u], z):
                first[u] = v
            if z <= 0.0:
                continue
            r = _half_window(z, fy, window_m)
            a = max(v - r, first[u])
            b = min(v + r, last[v, u])
            n = b - a + 1
            support = weights[b + 1, u] - weights[a, u]
            if n < 3 or support <= 0.5:
                continue
            centre = 0.5 * (a + b)
            s = total[b + 1, u] - total[a, u]
            slope_v = (moment[b + 1, u] - moment[a, u] - centre * s) / (n * (n * n - 1) / 12.0)
            # Gradient of 1/z on the normalised image plane, and its value at the principal point.
            nx = fx * (slopes[b + 1, u] - slopes[a, u]) / support
            ny = fy * slope_v
            nz = s / n + slope_v * (v - centre) - nx * (u - cx) / fx - ny * (v - cy) / fy
            # The plane lies at n · X = 1, in front of the camera: its normal towards the camera is −n.
            scale = -1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
            out[v, u, 0] = nx * scale
            out[v, u, 1] = ny * scale
            out[v, u, 2] = nz * scale
    return out
