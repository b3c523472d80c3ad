"""The verification score on the CPU: for machines without a GPU, and as a witness of the other renderer."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
from numba.core import config
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.scores import ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering import kernels
from verefine_viz.rendering.mesh import RenderMesh
from verefine_viz.rendering.prepared import MeshStore, TargetStore, far_m, intrinsics
from verefine_viz.rendering.rasterizer import draw_frame
from verefine_viz.rendering.results import PIXELS, as_poses, normals_image, score_maps, scores_from_sums

NOTHING_PLACED = np.zeros((0, 0), np.float32)


@cache
def _pool() -> ThreadPoolExecutor:
    # Threads of Python's own, as the kernels let go of the interpreter: numba's thread layers may not be entered twice
    # at once, and warn about old versions of TBB.
    return ThreadPoolExecutor(config.NUMBA_NUM_THREADS, "score")  # pyright: ignore


class CpuVerifier:
    """Scores poses with the numba rasteriser; may be used from any thread, one at a time.

    A batch is spread over ``NUMBA_NUM_THREADS`` threads (an environment variable; all cores unless it is set); the bits
    do not depend on how many.
    """

    name = "cpu"

    def __init__(self, settings: ScoreSettings, cache_folder: Path | None = None) -> None:
        self.settings = settings
        self._targets = TargetStore()
        self._meshes = MeshStore(settings.simplify_mm, cache_folder)
        self._n_threads = config.NUMBA_NUM_THREADS  # pyright: ignore
        self._placed_key: tuple[object, ...] | None = None
        self._placed_m = NOTHING_PLACED

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        """Scores of N poses (N, 4, 4); ``placed`` objects other than the target may hide parts (``classes``)."""
        Ts = as_poses(Ts_cam_obj)
        prepared = self._targets.get(target)
        settings = self.settings
        sums = np.empty((len(Ts), kernels.N_SUMS))
        arguments = (
            Ts,
            _arrays(self._meshes.get(target.model)),
            intrinsics(target.observation.camera, settings),
            far_m(settings),
            prepared.observed,
            prepared.flags,
            self._placed_depth(target, placed),
            prepared.n_objects,
            prepared.n_own,
            PIXELS[settings.pixels],
            settings.tau_m,
            settings.alpha,
            sums,
        )
        n = min(len(Ts), self._n_threads)
        others = [_pool().submit(kernels.score_every, k, n, *arguments) for k in range(1, n)]
        kernels.score_every(0, max(n, 1), *arguments)
        for other in others:
            other.result()
        return scores_from_sums(sums, settings)

    def maps(self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = ()) -> ScoreMaps:
        """The score of one pose, pixel by pixel."""
        T = as_poses(np.asarray(T_cam_obj)[None])[0]
        camera = target.observation.camera
        mesh = self._meshes.get(target.model)
        depth, face_of = self._frame(T, mesh, camera)
        normals = normals_image(mesh, T, depth, face_of, intrinsics(camera, self.settings))
        placed_m = self._placed_depth(target, placed)
        return score_maps(
            depth, normals, self._targets.get(target), placed_m if placed_m.size else None, self.settings
        )  # fmt: skip

    def _frame(self, T: Float, mesh: RenderMesh, camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        inv_z, face_of = np.zeros(camera.shape, np.float32), np.zeros(camera.shape, np.int32)
        draw_frame(T, *_arrays(mesh), *intrinsics(camera, self.settings), inv_z, face_of)
        depth = np.divide(1.0, inv_z, out=np.zeros_like(inv_z), where=inv_z > 0)
        depth[depth > far_m(self.settings)] = 0
        return depth, face_of

    def _placed_depth(self, target: Target, placed: Sequence[Placed]) -> NDArray[np.float32]:
        """(H, W) z of the other objects [m]; drawn once as long as they stay where they are."""
        others = [p for p in placed if p.instance_id != target.instance.instance_id]
        if not others:
            return NOTHING_PLACED
        camera = target.observation.camera
        key = (camera.K.tobytes(), camera.shape, *((p.model.mesh_hash, p.T_cam_obj.tobytes()) for p in others))
        if key != self._placed_key:
            inv_z, face_of = np.zeros(camera.shape, np.float32), np.zeros(camera.shape, np.int32)
            for p in others:
                mesh = _arrays(self._meshes.get(p.model))
                T = np.ascontiguousarray(p.T_cam_obj, dtype=np.float64)
                draw_frame(T, *mesh, *intrinsics(camera, self.settings), inv_z, face_of)
            self._placed_m = np.divide(1.0, inv_z, out=np.zeros_like(inv_z), where=inv_z > 0)
            self._placed_key = key
        return self._placed_m


def _arrays(mesh: RenderMesh) -> tuple[Float, NDArray[np.int32], Float, Float]:
    return mesh.vertices, mesh.faces, mesh.face_normals, mesh.face_offsets
