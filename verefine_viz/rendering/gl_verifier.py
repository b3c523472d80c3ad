"""The verification score on the GPU: poses as tiles of one atlas, summed there, a few numbers read back."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering import kernels
from verefine_viz.rendering.gl_context import create_context
from verefine_viz.rendering.gl_passes import GlPasses
from verefine_viz.rendering.prepared import MeshStore, TargetStore, far_m, intrinsics
from verefine_viz.rendering.score_sums import (
    NOTHING_PLACED,
    PIXELS,
    as_combinations,
    as_poses,
    in_order,
    score_maps,
    scores_from_sums,
)


class GlVerifier:
    """Scores poses with OpenGL 3.3; belongs to the thread that uses it first, where its context is made."""

    name = "gl"

    def __init__(
        self, settings: ScoreSettings, cache_folder: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
    ) -> None:
        self.settings = settings
        self._targets = TargetStore()
        self._meshes = MeshStore(settings.simplify_mm, cache_folder, progress)
        self._passes: GlPasses | None = None
        self._owner: threading.Thread | None = None
        self._placed_key: tuple[object, ...] | None = None

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        """Scores of N poses (N, 4, 4); ``placed`` objects other than the target may hide parts (``classes``).

        Raises:
            UnavailableError: no OpenGL, or called from another thread than before.
        """
        return self._score((target,), as_poses(Ts_cam_obj)[:, None], placed, True)

    def begin(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> None:
        """Nothing: the context belongs to one thread, which draws when it is asked to."""

    def maps(
        self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), at: PixelGrid | None = None
    ) -> ScoreMaps:
        """The score of one pose, pixel by pixel.

        Raises:
            UnavailableError: no OpenGL, or called from another thread than before.
        """
        return self._maps((target,), as_poses(np.asarray(T_cam_obj)[None]), placed, True, at)

    def score_scene(
        self, targets: Sequence[Target], Ts_cam_obj: Float, placed: Sequence[Placed] = (), whole_frame: bool = False
    ) -> Scores:
        """Scores of N combinations of poses (N, m, 4, 4) of m targets; see :meth:`CpuVerifier.score_scene`.

        Raises:
            ShapeError: another shape of poses, no targets, or targets of several frames.
            UnavailableError: no OpenGL, or called from another thread than before.
        """
        targets, Ts = in_order(targets, as_combinations(Ts_cam_obj, len(targets)))
        return self._score(targets, Ts, placed, whole_frame)

    def scene_maps(
        self,
        targets: Sequence[Target],
        Ts_cam_obj: Float,
        placed: Sequence[Placed] = (),
        whole_frame: bool = False,
        *,
        at: PixelGrid | None = None,
    ) -> ScoreMaps:
        """The scene's score of one combination (m, 4, 4), pixel by pixel; see :meth:`score_scene`."""
        targets, Ts = in_order(targets, as_combinations(np.asarray(Ts_cam_obj)[None], len(targets)))
        return self._maps(targets, Ts[0], placed, whole_frame, at)

    def _score(self, targets: Sequence[Target], Ts: Float, placed: Sequence[Placed], whole_frame: bool) -> Scores:
        passes, settings = self._gl(), self.settings
        prepared = self._targets.scene(targets, whole_frame)
        meshes = self._meshes.together([target.model for target in targets])
        frame = targets[0].observation.camera
        camera = intrinsics(frame, settings)
        has_placed = self._draw_placed(passes, targets, placed)
        windows = kernels.windows(Ts, meshes.arrays, camera, frame.height, frame.width)
        judging = {"pixels": PIXELS[settings.pixels], "tau_m": settings.tau_m, "alpha": settings.alpha}
        raw = np.zeros((len(Ts), 3, 4))
        for first, last in passes.batches(windows):
            part = Ts[first:last], windows[first:last], camera
            passes.draw_tiles(meshes, *part, far_m(settings))
            raw[first:last] = passes.sums(prepared, meshes, *part, has_placed, judging)
        return scores_from_sums(_columns(raw, prepared.n_own, prepared.n_objects, settings.pixels), settings)

    def _maps(
        self,
        targets: Sequence[Target],
        Ts: Float,
        placed: Sequence[Placed],
        whole_frame: bool,
        at: PixelGrid | None,
    ) -> ScoreMaps:
        passes, settings = self._gl(), self.settings
        meshes = self._meshes.together([target.model for target in targets])
        frame = targets[0].observation.camera
        camera = intrinsics(frame, settings)
        has_placed = self._draw_placed(passes, targets, placed)
        placed_m = passes.placed.read(frame.width, frame.height)[0] if has_placed else NOTHING_PLACED
        shows = kernels.windows(Ts[None], meshes.arrays, camera, frame.height, frame.width)[0, :, 2] > 0
        depth, face_of = np.zeros(frame.shape, np.float32), np.zeros(frame.shape, np.int64)
        if shows.any():
            whole = np.where(shows[:, None], [0, 0, frame.width, frame.height], 0)
            passes.draw_tiles(meshes, Ts[None], whole[None], camera, far_m(settings))
            depth, face_of = passes.atlas.read(frame.width, frame.height)
        at = at or PixelGrid.whole(frame.shape)
        seen = np.ix_(at.rows, at.columns)
        prepared = self._targets.scene(targets, whole_frame)
        return score_maps(meshes, Ts, at, depth[seen], face_of[seen], camera, prepared, placed_m, settings)

    def close(self) -> None:
        """Gives the context back; the next call makes a new one."""
        if self._passes is not None:
            self._gl().context.release()
        self._passes = self._owner = self._placed_key = None

    def _gl(self) -> GlPasses:
        here = threading.current_thread()
        if self._passes is None:
            self._passes, self._owner = GlPasses(create_context()), here
        if self._owner is not here:
            owner = self._owner.name if self._owner else "?"
            raise UnavailableError(
                f"the OpenGL verifier belongs to thread {owner!r}, which used it first, and was called from thread "
                f"{here.name!r}; make one verifier per thread"
            )
        self._passes.context.__enter__()
        self._passes.collect()
        return self._passes

    def _draw_placed(self, passes: GlPasses, targets: Sequence[Target], placed: Sequence[Placed]) -> bool:
        """Draws the other objects, once as long as they stay where they are; False where there are none."""
        judged = [target.instance.instance_id for target in targets]
        others = [p for p in placed if p.instance_id not in judged]
        if not others:
            return False
        frame = targets[0].observation.camera
        key = (frame.K.tobytes(), frame.shape, *((p.model.mesh_hash, p.T_cam_obj.tobytes()) for p in others))
        if key != self._placed_key:
            items = [(self._meshes.get(p.model), p.T_cam_obj) for p in others]
            passes.draw_scene(items, frame.shape, intrinsics(frame, self.settings), np.inf)
            self._placed_key = key
        return True


def _columns(raw: Float, n_own: int, n_objects: int, pixels: str) -> NDArray[np.float64]:
    """The sums (N, ``N_SUMS``) of :mod:`kernels` from those of the shader (N, 3, 4)."""
    (sum_d, sum_n, rendered, stray), (explained, blocked, protruding, hidden) = raw[:, 0].T, raw[:, 1].T
    unknown, covered = raw[:, 2, 0], raw[:, 2, 1]
    missed = blocked + n_own - covered
    n = {"published": n_objects + stray, "observed": n_own + 0 * stray, "classes": explained + missed + protruding}
    return np.stack([sum_d, sum_n, n[pixels], rendered, explained, missed, protruding, hidden, unknown], axis=1)
