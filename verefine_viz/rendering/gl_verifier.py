"""The verification score on the GPU: all poses of a batch are drawn and summed there at once, and a few numbers read
back.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, writable
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.colour import N_COLOUR_SUMS
from verefine_viz.rendering.gl_context import create_context
from verefine_viz.rendering.gl_passes import GlPasses, batches
from verefine_viz.rendering.prepared import far_m, intrinsics
from verefine_viz.rendering.rasterizer import is_drawable
from verefine_viz.rendering.score_kernels import windows
from verefine_viz.rendering.verifier import (
    NOTHING_PLACED,
    RenderingVerifier,
    rule_of,
    score_maps,
    scores_from_sums,
    with_colours,
)


class GlVerifier(RenderingVerifier):
    """Scores poses with OpenGL 4.3; belongs to the thread that uses it first, which makes its context.

    Every call raises an UnavailableError where there is no OpenGL 4.3, or when it comes from another thread.
    """

    name = "gl"

    def __init__(
        self, settings: ScoreSettings, cache_folder: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
    ) -> None:
        super().__init__(settings, cache_folder, progress)
        self._passes: GlPasses | None = None
        self._owner: threading.Thread | None = None

    def begin(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> None:
        """None: the context belongs to one thread, which draws only when called."""

    def _score(self, targets: Sequence[Target], Ts: Float, placed: Sequence[Placed], whole_frame: bool) -> Scores:
        passes, settings = self._gl(), self.settings
        prepared = self._targets.scene(targets, whole_frame)
        meshes = self._meshes.together([target.model for target in targets])
        frame = targets[0].observation.camera
        camera = intrinsics(frame, settings)
        has_placed = self._draw_placed(passes, targets, placed)
        shown = windows(Ts, meshes.arrays, camera, frame.height, frame.width)
        raw, colours = np.zeros((len(Ts), 3, 4)), self._colours.scene(targets)
        colour_sums = np.zeros((len(Ts), len(targets), N_COLOUR_SUMS))
        for part in batches(shown):
            drawn = passes.draw(meshes, Ts[part], shown[part], camera, far_m(settings))
            raw[part] = passes.sums(drawn, prepared, has_placed, rule_of(settings))
            if colours is not None:
                colour_sums[part] = passes.colour_sums(drawn, prepared, colours, settings.tau_m)
        sums = _columns(raw, prepared.n_own, prepared.n_objects, settings.pixels)
        return scores_from_sums(sums, colour_sums, colours, settings)

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
        placed_m = passes.placed_depth(frame.shape) if has_placed else NOTHING_PLACED
        shows = windows(Ts[None], meshes.arrays, camera, frame.height, frame.width)[0, :, 2] > 0
        whole = np.where(shows[:, None], [0, 0, frame.width, frame.height], 0)
        drawn = passes.draw(meshes, Ts[None], whole[None], camera, far_m(settings))
        depth, face_of = np.zeros(frame.shape, np.float32), np.zeros(frame.shape, np.int64)
        if shows.any():
            depth, face_of = passes.picture(frame.shape)
        at = at or PixelGrid.whole(frame.shape)
        seen = np.ix_(at.rows, at.columns)
        prepared, colours = self._targets.scene(targets, whole_frame), self._colours.scene(targets)
        maps = score_maps(meshes, Ts, at, depth[seen], face_of[seen], camera, prepared, placed_m, settings)
        if colours is None:
            return maps
        sums = passes.colour_sums(drawn, prepared, colours, settings.tau_m)[0]
        return with_colours(maps, colours, sums, Ts, at, meshes.model_of(face_of[seen]), camera)

    def close(self) -> None:
        """Releases the context; the next call makes a new one."""
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
        """Draws the other objects, again only when they have moved; returns False where there are none."""
        others, key = self._others(targets, placed)
        if not others:
            return False
        if key != self._placed_key:
            frame = targets[0].observation.camera
            drawn = [(self._meshes.together([p.model]), T) for p in others if is_drawable(T := writable(p.T_cam_obj))]
            passes.draw_placed(drawn, frame.shape, intrinsics(frame, self.settings))
            self._placed_key = key
        return True


def _columns(raw: Float, n_own: int, n_objects: int, pixels: str) -> NDArray[np.float64]:
    """The sums (N, ``N_SUMS``) of :mod:`score_kernels` from those of the shader (N, 3, 4)."""
    (sum_d, sum_n, rendered, stray), (explained, blocked, protruding, hidden) = raw[:, 0].T, raw[:, 1].T
    unknown, covered = raw[:, 2, 0], raw[:, 2, 1]
    missed = blocked + n_own - covered
    n = {"published": n_objects + stray, "observed": n_own + 0 * stray, "classes": explained + missed + protruding}
    return np.stack([sum_d, sum_n, n[pixels], rendered, explained, missed, protruding, hidden, unknown], axis=1)
