"""How many pixels a scene leaves unexplained: the cost of PHYSIM-MCTS. docs/methods.md 3.1, 3.3.

The observed picture is the depth with the table removed: points less than ``TABLE_M`` above the support plane, or below
it, are no objects. Everything else on the plane stays, even things that are not to be solved: they cost every scene the
same. Without a support plane, only what the masks of the frame's objects cover counts as observed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import writable
from verefine_viz.core.kernels import kernel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.prepared import MeshStore, intrinsics
from verefine_viz.rendering.rasterizer import draw_frame

TABLE_M = 0.005
"""Points nearer to the support plane than this belong to it [m]."""


class ExplainedPixels:
    """Draws scenes on the CPU and compares them with the observed objects."""

    def __init__(
        self,
        explained_m: float,
        score: ScoreSettings,
        cache_folder: Path | None = None,
        progress: ProgressToken = NEVER_CANCELLED,
    ) -> None:
        """Draws with the meshes and pixel centres of the verification score.

        Args:
            explained_m: a pixel whose observed and drawn depth differ by more than this is unexplained [m].
            score: how meshes are simplified and where pixel centres lie.
            cache_folder: folder of simplified meshes; by default in the user's cache folder.
            progress: checked where one has to be made.
        """
        self._explained_m = explained_m
        self._settings = score
        self._meshes = MeshStore(score.simplify_mm, cache_folder, progress)
        self._observed: WeakKeyDictionary[Observation, NDArray[np.float32]] = WeakKeyDictionary()

    def unexplained_px(self, observation: Observation, scene: Sequence[Placed]) -> int:
        """Number of pixels in which the drawn scene and the observed objects differ, or only one of them exists."""
        return int(_count(self.observed_m(observation), self._inv_z(observation, scene), self._explained_m))

    def unexplained(self, observation: Observation, scene: Sequence[Placed]) -> NDArray[np.bool_]:
        """Mask (H, W) of these pixels, for display."""
        observed, rendered = self.observed_m(observation), self.depth_m(observation, scene)
        difference_m = np.abs(observed.astype(np.float64) - rendered)
        return ((observed > 0) | (rendered > 0)) & (difference_m > self._explained_m)

    def depth_m(self, observation: Observation, scene: Sequence[Placed]) -> NDArray[np.float32]:
        """The scene drawn into one depth image (H, W) [m]; 0 where it is empty."""
        inv_z = self._inv_z(observation, scene)
        return np.divide(1.0, inv_z, out=np.zeros_like(inv_z), where=inv_z > 0)

    def observed_m(self, observation: Observation) -> NDArray[np.float32]:
        """The depth image (H, W) with the table removed [m]; 0 where nothing is. Made once per observation."""
        observed = self._observed.get(observation)
        if observed is None:
            observed = self._observed[observation] = without_table(observation)
        return observed

    def _inv_z(self, observation: Observation, scene: Sequence[Placed]) -> NDArray[np.float32]:
        camera = observation.camera
        inv_z, face_of = np.zeros(camera.shape, np.float32), np.empty(camera.shape, np.int32)
        for placed in scene:
            mesh = self._meshes.get(placed.model)
            T = writable(placed.T_cam_obj)
            draw_frame(T, *mesh.arrays, *intrinsics(camera, self._settings), inv_z, face_of)
        return inv_z


def without_table(observation: Observation) -> NDArray[np.float32]:
    """The depth image (H, W) of the things on the support plane [m]; 0 elsewhere."""
    depth_m = np.where(np.isfinite(observation.depth_m) & (observation.depth_m > 0), observation.depth_m, 0)
    support = observation.support
    if support is None:
        return np.where(observation.object_mask, depth_m, 0).astype(np.float32)
    normal_cam = support.T_world_cam[:3, :3].T @ support.normal_world
    height_m = observation.camera.back_project(depth_m) @ normal_cam + support.T_world_cam[:3, 3] @ support.normal_world
    return np.where(height_m >= TABLE_M, depth_m, 0).astype(np.float32)


@kernel()
def _count(observed_m: np.ndarray, inv_z: np.ndarray, limit_m: float) -> int:
    n = 0
    for v in range(observed_m.shape[0]):
        for u in range(observed_m.shape[1]):
            observed, drawn = np.float64(observed_m[v, u]), np.float64(inv_z[v, u])
            if abs(observed - 1.0 / drawn if drawn > 0.0 else observed) > limit_m:
                n += 1
    return n
