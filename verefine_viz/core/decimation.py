"""Reduces the triangles of a mesh by fast_simplification; the only place that calls it."""

from __future__ import annotations

import threading

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float

_ALONE = threading.Lock()
"""The library keeps the mesh that it works on in globals, and lets other threads run between loading, simplifying and
returning it: of two calls at the same time, one would get the other's mesh."""

AGGRESSIVENESS = 7.0
"""How fast the library raises its error threshold; lower values stop short of the wanted count."""


def decimated(vertices: Float, faces: NDArray[np.integer], n_faces: int) -> tuple[Float, NDArray[np.int32]]:
    """Vertices (v, 3) and faces (f, 3) of a mesh with about ``n_faces`` triangles, from any thread.

    Args:
        vertices: (V, 3). The library's thresholds are absolute: what is asked for is best kept in a mesh of size 1.
        faces: (F, 3).
        n_faces: how many to stop at, at most F.
    """
    # The library takes no read-only arrays.
    points, triangles = np.array(vertices, np.float64), np.array(faces, np.int32)
    with _ALONE:
        fewer = fast_simplification.simplify(points, triangles, target_count=n_faces, agg=AGGRESSIVENESS)
    return fewer[0], fewer[1].astype(np.int32)
