"""Open3D's ray casting on one mesh: where rays meet it, and which of its points is nearest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float

if TYPE_CHECKING:
    import open3d as o3d


def ray_scene(vertices: Float, faces: NDArray[np.integer]) -> o3d.t.geometry.RaycastingScene:
    """Open3D's scene of the mesh with ``vertices`` (N, 3) and ``faces`` (F, 3)."""
    # Open3D takes more than a second to import: only where it is needed, so that the page is there before.
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(np.array(vertices, dtype=np.float32)),
        o3d.core.Tensor.from_numpy(np.array(faces, dtype=np.uint32)),
    )
    return scene


def queries(rows: Float) -> o3d.core.Tensor:
    """Rays (N, 6) or points (N, 3) as the float32 tensor that a scene takes."""
    import open3d as o3d

    return o3d.core.Tensor.from_numpy(rows.astype(np.float32))
