"""The outline of a model in the image: what is rendered, whether hidden by others or not."""

from __future__ import annotations

from functools import lru_cache

import contourpy
import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, writable
from verefine_viz.core.camera import Camera
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.mesh import RenderMesh
from verefine_viz.rendering.rasterizer import draw, window
from verefine_viz.rendering.simplify import scoring_mesh

FINER = 2
"""So many times finer than the camera's pixels a silhouette is drawn."""
LARGE_PX = 400
"""Models larger than this in the image are drawn in the camera's own pixels."""
DEVIATION_PX = 0.2
"""How far the polygon may be from the outline."""
SMOOTHED = 5
"""Points of a pixel's staircase that are averaged."""


def outline(model: ObjectModel, T_cam_obj: Float, camera: Camera) -> list[list[float]]:
    """The outline of a model as closed polygons [u, v, u, v, …], to a tenth of a pixel; none where it is not in the
    image. Pixel centres are whole.
    """
    return polygons(drawn_mesh(model), T_cam_obj, camera)


@lru_cache(maxsize=64)
def drawn_mesh(model: ObjectModel) -> RenderMesh:
    """The mesh that is scored unless a session says otherwise; it deviates by less than what can be seen."""
    return scoring_mesh(model, ScoreSettings().simplify_mm)


def polygons(mesh: RenderMesh, T_cam_obj: Float, camera: Camera) -> list[list[float]]:
    """The outline of a mesh as closed polygons, to a tenth of a pixel; empty where it is not in the image."""
    finer = FINER
    drawn = _drawn(mesh, T_cam_obj, camera, finer)
    if drawn is None:
        return []
    if max(drawn[0].shape) > FINER * LARGE_PX:
        finer = 1
        drawn = _drawn(mesh, T_cam_obj, camera, finer)
        assert drawn is not None
    silhouette, low = drawn
    lines = contourpy.contour_generator(z=silhouette).lines(0.5)
    # The silhouette has a rim of one pixel; the centre of a fine pixel x lies at (x + 0.5) / finer − 0.5.
    placed = [(simplified(line, DEVIATION_PX * finer) - 1 + low + 0.5) / finer - 0.5 for line in lines]  # type: ignore
    return [np.round(line, 1).ravel().tolist() for line in placed]


def _drawn(mesh: RenderMesh, T_cam_obj: Float, camera: Camera, finer: int) -> tuple[NDArray, NDArray] | None:
    """The silhouette (h + 2, w + 2) in finer pixels with a rim of zeros, and its first column and row."""
    pinhole = camera.fx * finer, camera.fy * finer, (camera.cx + 0.5) * finer - 0.5, (camera.cy + 0.5) * finer - 0.5
    shape = camera.height * finer, camera.width * finer
    x0, y0, silhouette = _silhouette(writable(T_cam_obj), *mesh.arrays, *pinhole, *shape)
    return (silhouette, np.array([x0, y0])) if silhouette.size else None


@kernel(nogil=True)
def _silhouette(T, vertices, faces, normals, offsets, closed, fx, fy, cx, cy, height, width):
    projected = np.empty((len(vertices), 3))
    x0, y0, columns, rows, n_front = window(T, vertices, fx, fy, cx, cy, height, width, projected)
    if columns == 0:
        return 0, 0, np.zeros((0, 0), np.float32)
    inv_z, face_of = np.zeros((rows, columns), np.float32), np.empty((rows, columns), np.int32)
    draw(
        T, vertices, faces, normals, offsets, closed, projected, n_front,
        fx, fy, cx, cy, inv_z, face_of, x0, y0, np.int64(0),
    )  # fmt: skip
    out = np.zeros((rows + 2, columns + 2), np.float32)
    for y in range(rows):
        for x in range(columns):
            out[y + 1, x + 1] = 1.0 if inv_z[y, x] > 0 else 0.0
    return x0, y0, out


@kernel(nogil=True)
def simplified(line, deviation):
    """A closed line (n, 2), first point = last, smoothed and with as few points as the deviation allows (m, 2).

    The last point is not repeated.
    """
    n = len(line) - 1
    if n < 4 * SMOOTHED:
        return line[:n].copy()
    ring = np.zeros((n + 1, 2))
    for i in range(n + 1):
        for k in range(-(SMOOTHED // 2), SMOOTHED // 2 + 1):
            ring[i] += line[(i + k) % n] / SMOOTHED
    # Douglas and Peucker, on the halves between a point and the one across.
    stays, first, last, depth = np.zeros(n + 1, np.bool_), np.empty(n + 1, np.int64), np.empty(n + 1, np.int64), 2
    first[0], last[0], first[1], last[1] = 0, n // 2, n // 2, n
    stays[0] = stays[n // 2] = True
    while depth > 0:
        depth -= 1
        a, b = first[depth], last[depth]
        dx, dy = ring[b, 0] - ring[a, 0], ring[b, 1] - ring[a, 1]
        length = max(np.sqrt(dx * dx + dy * dy), 1e-9)
        farthest, at = deviation, -1
        for i in range(a + 1, b):
            distance = abs(dx * (ring[i, 1] - ring[a, 1]) - dy * (ring[i, 0] - ring[a, 0])) / length
            if distance > farthest:
                farthest, at = distance, i
        if at >= 0:
            stays[at] = True
            first[depth], last[depth], first[depth + 1], last[depth + 1] = a, at, at, b
            depth += 2
    return ring[:n][stays[:n]]
