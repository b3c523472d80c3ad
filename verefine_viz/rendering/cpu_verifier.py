"""The verification score on the CPU: for machines without a GPU, and to check the other renderer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import config
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, writable
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.colour import N_COLOUR_SUMS, NO_COLOURS, SceneColours
from verefine_viz.rendering.prepared import PreparedTarget, far_m, intrinsics
from verefine_viz.rendering.rasterizer import draw_depth
from verefine_viz.rendering.score_kernels import N_SUMS, draw_at, score_every
from verefine_viz.rendering.verifier import (
    NOTHING_PLACED,
    RenderingVerifier,
    as_poses,
    rule_of,
    score_maps,
    scores_from_sums,
    with_colours,
)

FACES_PER_THREAD = 2500
"""Fewest faces to draw in a thread: handing over takes as long as drawing a small mesh."""


@cache
def _pool() -> ThreadPoolExecutor:
    # Threads of Python's own, as the kernels release the interpreter's lock: numba's thread layers may not be entered
    # twice at once, and warn about old versions of TBB.
    return ThreadPoolExecutor(config.NUMBA_NUM_THREADS, "score")  # pyright: ignore


@dataclass(frozen=True, eq=False)
class _KernelScene:
    """The kernel's arguments that do not depend on poses."""

    targets: tuple[Target, ...]
    whole_frame: bool
    drawing: tuple[Any, ...]
    """Meshes, camera, far limit."""
    prepared: PreparedTarget


class CpuVerifier(RenderingVerifier):
    """Scores poses with the numba rasteriser; may be used from any thread, one at a time.

    A batch is spread over ``NUMBA_NUM_THREADS`` threads (an environment variable; all cores unless it is set); the bits
    do not depend on how many.
    """

    name = "cpu"

    def __init__(
        self, settings: ScoreSettings, cache_folder: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
    ) -> None:
        super().__init__(settings, cache_folder, progress)
        self._n_threads = config.NUMBA_NUM_THREADS  # pyright: ignore
        self._scene: _KernelScene | None = None
        """Scene of the last call, usually needed by the next one, too."""
        self._placed_m = NOTHING_PLACED

    def begin(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Callable[[], Scores] | None:
        """Scores in another thread as :meth:`score` would; the returned function waits for the result; None without
        another thread.
        """
        if self._n_threads < 2:
            return None
        arguments, colours = self._arguments((target,), as_poses(Ts_cam_obj)[:, None], placed, True)
        working = _pool().submit(score_every, 0, 1, *arguments)

        def answer() -> Scores:
            working.result()
            return scores_from_sums(arguments[-2], arguments[-1], colours, self.settings)

        return answer

    def _score(self, targets: Sequence[Target], Ts: Float, placed: Sequence[Placed], whole_frame: bool) -> Scores:
        arguments, colours = self._arguments(targets, Ts, placed, whole_frame)
        n_faces = len(Ts) * sum(len(self._meshes.get(target.model).faces) for target in targets)
        n = max(1, min(len(Ts), self._n_threads, n_faces // FACES_PER_THREAD))
        others = [_pool().submit(score_every, k, n, *arguments) for k in range(1, n)]
        score_every(0, n, *arguments)
        for other in others:
            other.result()
        return scores_from_sums(arguments[-2], arguments[-1], colours, self.settings)

    def _arguments(
        self, targets: Sequence[Target], Ts: Float, placed: Sequence[Placed], whole_frame: bool
    ) -> tuple[tuple[Any, ...], SceneColours | None]:
        """The kernel's arguments after the first two, the last two of which receive its sums; and the colours, if they
        count.
        """
        scene, settings = self._scene, self.settings
        if scene is None or scene.whole_frame != whole_frame or scene.targets != tuple(targets):
            meshes = self._meshes.together([target.model for target in targets])
            drawing = meshes.arrays, intrinsics(targets[0].observation.camera, settings), far_m(settings)
            scene = _KernelScene(tuple(targets), whole_frame, drawing, self._targets.scene(targets, whole_frame))
            self._scene = scene
        seen = scene.prepared.arrays(self._placed_depth(targets, placed))
        colours = self._colours.scene(targets)
        arrays, n = NO_COLOURS if colours is None else colours.arrays, len(Ts)
        sums = np.empty((n, N_SUMS)), np.zeros((n, len(targets), N_COLOUR_SUMS))
        return (Ts, *scene.drawing, seen, rule_of(settings), arrays, *sums), colours

    def _maps(
        self,
        targets: Sequence[Target],
        Ts: Float,
        placed: Sequence[Placed],
        whole_frame: bool,
        at: PixelGrid | None,
    ) -> ScoreMaps:
        camera = targets[0].observation.camera
        at = at or PixelGrid.whole(camera.shape)
        meshes = self._meshes.together([target.model for target in targets])
        pinhole, shape = intrinsics(camera, self.settings), (len(at.rows), len(at.columns))
        depth_m, faces = np.zeros(shape, np.float32), np.zeros(shape, np.int32)
        Ts = writable(Ts)
        draw_at(Ts, meshes.arrays, pinhole, camera.shape, far_m(self.settings), at.rows, at.columns, depth_m, faces)
        prepared, placed_m = self._targets.scene(targets, whole_frame), self._placed_depth(targets, placed)
        maps = score_maps(meshes, Ts, at, depth_m, faces, pinhole, prepared, placed_m, self.settings)
        colours = self._colours.scene(targets)
        if colours is None:
            return maps
        arguments, _ = self._arguments(targets, Ts[None], placed, whole_frame)
        score_every(0, 1, *arguments)
        return with_colours(maps, colours, arguments[-1][0], Ts, at, meshes.model_of(faces), pinhole)

    def _placed_depth(self, targets: Sequence[Target], placed: Sequence[Placed]) -> NDArray[np.float32]:
        """(H, W) z of the other objects [m]; drawn again only when they have moved."""
        others, key = self._others(targets, placed)
        if not others:
            return NOTHING_PLACED
        if key != self._placed_key:
            camera = targets[0].observation.camera
            depth_m = np.zeros(camera.shape, np.float32)
            for p in others:
                T = writable(p.T_cam_obj)
                draw_depth(T, *self._meshes.get(p.model).arrays, *intrinsics(camera, self.settings), depth_m)
            self._placed_m, self._placed_key = depth_m, key
        return self._placed_m
