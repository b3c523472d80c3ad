"""Surface normals of a depth image.

A plane is linear in inverse depth: ``n · X = d`` with ``X = z (x, y, 1)`` gives ``1/z = (n_x x + n_y y + n_z) / d`` on
the normalised image plane, so the normal is the gradient of ``1/z`` there, and a least-squares fit of ``1/z`` is exact
on tilted planes whatever the window. The fit is separable: slopes along rows first, then those of the rows along
columns, each from running sums, so its cost does not grow with the window. docs/methods.md 1.8.5 shows how other fits
fail.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.camera import Camera
from verefine_viz.core.kernels import kernel
from verefine_viz.core.scores import PixelGrid

WINDOW_M = 0.008
"""Half-width of the fitted window on a surface that faces the camera [m]."""
MIN_WINDOW_PX = 2
"""Smallest half-width [px]: three samples are the fewest that can check a slope."""
MAX_WINDOW_PX = 12
"""Largest half-width [px], reached where the camera is very near."""
JUMP_M = 0.006
"""Depth step between neighbouring pixels that ends a surface, up to 1 m away [m]; beyond, it grows with z², as noise
does."""


def estimate_normals(
    depth_m: NDArray[np.floating], camera: Camera, window_m: float = WINDOW_M, at: PixelGrid | None = None
) -> NDArray[np.float32]:
    """Unit normals towards the camera, (H, W, 3) in the camera frame; 0 where none could be estimated.

    A window is metric (``window_m`` to each side, so fewer pixels far away). It stops at depth jumps and at pixels
    without depth, where its pixel may lie off its middle.

    Args:
        depth_m: z, (H, W) [m]; 0 where nothing was measured.
        camera: intrinsics of the depth image.
        window_m: half-width of the window [m]; larger is smoother and rounds edges more.
        at: the pixels (h rows, w columns) whose normals are wanted, (h, w, 3); None = all.
    """
    depth = np.ascontiguousarray(depth_m, dtype=np.float64)
    at = at or PixelGrid.whole(depth.shape)
    return _normals(depth, camera.fx, camera.fy, camera.cx, camera.cy, window_m, at.rows, at.columns)


@kernel()
def _is_jump(z: float, z_next: float) -> bool:
    nearer = min(z, z_next)
    return not (z > 0.0 and z_next > 0.0) or abs(z - z_next) > JUMP_M * max(1.0, nearer * nearer)


@kernel()
def _half_window(z: float, focal_px: float, window_m: float) -> int:
    # Clamped before it becomes an integer, which a huge focal length would overflow.
    return round(min(max(MIN_WINDOW_PX, window_m * focal_px / z), MAX_WINDOW_PX))


@kernel()
def _fit_rows(
    depth: np.ndarray, fx: float, window_m: float, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each pixel of the columns, a line fitted to ``1/z`` along the row: its slope per pixel, its value at the
    pixel, the slope's weight.
    """
    h, w = depth.shape
    slope = np.zeros((h, len(columns)))
    value = np.zeros((h, len(columns)))
    weight = np.zeros((h, len(columns)))
    total = np.zeros(w + 1)
    moment = np.zeros(w + 1)
    first = np.zeros(w, dtype=np.int64)
    last = np.zeros(w, dtype=np.int64)
    for v in range(h):
        end = w - 1
        for u in range(w - 1, -1, -1):  # last[u]: the last pixel of the run of surface that u belongs to
            if u == w - 1 or _is_jump(depth[v, u], depth[v, u + 1]):
                end = u
            last[u] = end
        start = 0
        for u in range(w):
            if u > 0 and last[u - 1] == u - 1:
                start = u
            first[u] = start
            q = 1.0 / depth[v, u] if depth[v, u] > 0.0 else 0.0
            total[u + 1] = total[u] + q
            moment[u + 1] = moment[u] + q * u
        for j in range(len(columns)):
            u = int(columns[j])
            z = depth[v, u]
            if z <= 0.0:
                continue
            r = _half_window(z, fx, window_m)
            a = max(u - r, first[u])
            b = min(u + r, last[u])
            n = b - a + 1
            centre = 0.5 * (a + b)
            s = total[b + 1] - total[a]
            if n < 3:
                value[v, j] = 1.0 / z
                continue
            spread = n * (n * n - 1) / 12.0
            slope[v, j] = (moment[b + 1] - moment[a] - centre * s) / spread
            value[v, j] = s / n + slope[v, j] * (u - centre)
            weight[v, j] = spread
    return slope, value, weight


@kernel()
def _normals(
    depth: np.ndarray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    window_m: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    h, w = len(depth), len(columns)
    slope_u, value, weight = _fit_rows(depth, fx, window_m, columns)
    # Running sums down the columns, stored row by row so that memory is read in order.
    total = np.zeros((h + 1, w))
    moment = np.zeros((h + 1, w))
    slopes = np.zeros((h + 1, w))
    weights = np.zeros((h + 1, w))
    first = np.zeros((h, w), dtype=np.int32)
    last = np.zeros((h, w), dtype=np.int32)
    for v in range(h - 1, -1, -1):
        for j in range(w):
            ends = v == h - 1 or _is_jump(depth[v, columns[j]], depth[v + 1, columns[j]])
            last[v, j] = v if ends else last[v + 1, j]
    for v in range(h):
        for j in range(w):
            first[v, j] = v if v == 0 or last[v - 1, j] == v - 1 else first[v - 1, j]
            total[v + 1, j] = total[v, j] + value[v, j]
            moment[v + 1, j] = moment[v, j] + value[v, j] * v
            slopes[v + 1, j] = slopes[v, j] + slope_u[v, j] * weight[v, j]
            weights[v + 1, j] = weights[v, j] + weight[v, j]
    out = np.zeros((len(rows), w, 3), dtype=np.float32)
    for i in range(len(rows)):
        v = int(rows[i])
        for j in range(w):
            u = int(columns[j])
            z = depth[v, u]
            if z <= 0.0:
                continue
            r = _half_window(z, fy, window_m)
            a = max(v - r, first[v, j])
            b = min(v + r, last[v, j])
            n = b - a + 1
            support = weights[b + 1, j] - weights[a, j]
            if n < 3 or support <= 0.5:
                continue
            centre = 0.5 * (a + b)
            s = total[b + 1, j] - total[a, j]
            slope_v = (moment[b + 1, j] - moment[a, j] - centre * s) / (n * (n * n - 1) / 12.0)
            # Gradient of 1/z on the normalised image plane, and its value at the principal point.
            nx = fx * (slopes[b + 1, j] - slopes[a, j]) / support
            ny = fy * slope_v
            nz = s / n + slope_v * (v - centre) - nx * (u - cx) / fx - ny * (v - cy) / fy
            # The plane lies at n · X = 1, in front of the camera: its normal towards the camera is −n.
            scale = -1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
            out[i, j, 0] = nx * scale
            out[i, j, 1] = ny * scale
            out[i, j, 2] = nz * scale
    return out
