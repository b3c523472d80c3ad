"""What both verifiers of Eq. 1 share: from sums over pixels to scores, from pictures to score maps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, writable
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import as_poses
from verefine_viz.core.kernels import kernel
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.colour import ColourStore, SceneColours, local_correlation, rgb_of
from verefine_viz.rendering.mesh import RenderMeshes
from verefine_viz.rendering.prepared import MeshStore, PreparedTarget, TargetStore
from verefine_viz.rendering.score_kernels import (
    CLASSES,
    EXPLAINED,
    HIDDEN,
    N_SUMS,
    OBSERVED,
    PUBLISHED,
    UNKNOWN,
    fill_maps,
)

_PIXELS = {"published": PUBLISHED, "observed": OBSERVED, "classes": CLASSES}

NOTHING_PLACED = np.zeros((0, 0), np.float32)
"""z of the objects placed before, where there are none."""

LEAST_SEEN_SHARE = 0.1
"""``classes``: a pose of whose pixels fewer than this share can be compared (neither hidden nor unmeasured) has its
score lowered in proportion, so that no pose can hide where nothing was measured. docs/methods.md 1.9."""


class RenderingVerifier(ABC):
    """A verifier (core.protocols) that draws poses; how, is up to :meth:`_score` and :meth:`_maps`."""

    def __init__(
        self, settings: ScoreSettings, cache_folder: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
    ) -> None:
        self.settings = settings
        self._targets = TargetStore()
        self._meshes = MeshStore(settings.simplify_mm, cache_folder, progress)
        self._colours = ColourStore(settings.colour_weight)
        self._placed_key: tuple[object, ...] | None = None
        """Key of the placed objects that are drawn."""

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        """Scores of N poses (N, 4, 4); ``placed`` objects other than the target may hide parts (``classes``).

        Raises:
            ShapeError: another shape. NaN is let through: such a pose scores 0.
        """
        return self._score((target,), as_poses(Ts_cam_obj)[:, None], placed, True)

    def maps(
        self, target: Target, T_cam_obj: Float, placed: Sequence[Placed] = (), at: PixelGrid | None = None
    ) -> ScoreMaps:
        """The score of one pose, pixel by pixel; ``at`` some pixels, or all."""
        return self._maps((target,), as_poses(np.asarray(T_cam_obj)[None]), placed, True, at)

    def score_scene(
        self, targets: Sequence[Target], Ts_cam_obj: Float, placed: Sequence[Placed] = (), whole_frame: bool = False
    ) -> Scores:
        """Scores of N combinations of poses (N, m, 4, 4) of m targets, each combination in one depth buffer.

        Args:
            targets: of one frame; their order does not matter.
            Ts_cam_obj: a pose that is not finite, or shows nothing, leaves its object's mask empty.
            placed: objects other than the targets that may hide parts (``classes``).
            whole_frame: ``published`` counts the pixels of all objects in the frame, as :meth:`score` does.

        Raises:
            ShapeError: another shape of poses, no targets, or targets of several frames.
        """
        return self._score(*_sorted_placements(targets, Ts_cam_obj), placed, whole_frame)

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
        targets, Ts = _sorted_placements(targets, np.asarray(Ts_cam_obj)[None])
        return self._maps(targets, Ts[0], placed, whole_frame, at)

    @abstractmethod
    def _score(self, targets: Sequence[Target], Ts: Float, placed: Sequence[Placed], whole_frame: bool) -> Scores:
        """Scores of combinations (N, m, 4, 4) of targets in order of their instances."""

    @abstractmethod
    def _maps(
        self,
        targets: Sequence[Target],
        Ts: Float,
        placed: Sequence[Placed],
        whole_frame: bool,
        at: PixelGrid | None,
    ) -> ScoreMaps:
        """The score of one combination (m, 4, 4), pixel by pixel."""

    def _others(
        self, targets: Sequence[Target], placed: Sequence[Placed]
    ) -> tuple[list[Placed], tuple[object, ...] | None]:
        """The placed objects that are none of the targets, and a key of what they look like."""
        ids = [target.instance.instance_id for target in targets]
        others = [p for p in placed if p.instance_id not in ids]
        camera = targets[0].observation.camera
        poses = ((p.model.mesh_hash, p.T_cam_obj.tobytes()) for p in others)
        return others, (camera.K.tobytes(), camera.shape, *poses) if others else None


def rule_of(settings: ScoreSettings) -> tuple[int, float, float]:
    """The pixels that count, as the renderers' code, τ [m] and α."""
    return _PIXELS[settings.pixels], settings.tau_m, settings.alpha


def _sorted_placements(targets: Sequence[Target], Ts_cam_obj: Float) -> tuple[tuple[Target, ...], Float]:
    """Targets and their poses as a contiguous (N, m, 4, 4), by instance: the same bits in any order.

    Raises:
        ShapeError: another shape, or no target. NaN is let through: such a pose shows nothing.
    """
    Ts = np.ascontiguousarray(Ts_cam_obj, dtype=np.float64)
    if len(targets) == 0:
        raise ShapeError("a scene of no targets cannot be scored, expected at least one")
    if Ts.ndim != 4 or Ts.shape[1:] != (len(targets), 4, 4):
        raise ShapeError(f"the combinations to score have shape {Ts.shape}, expected n×{len(targets)}×4×4")
    order = sorted(range(len(targets)), key=lambda k: targets[k].instance.instance_id)
    return tuple(targets[k] for k in order), np.ascontiguousarray(Ts[:, order])


def scores_from_sums(sums: Float, colour_sums: Float, colours: SceneColours | None, settings: ScoreSettings) -> Scores:
    """Scores of N combinations of poses from their sums: the averages of Eq. 1, and the colour term.

    Args:
        sums: (N, ``N_SUMS``).
        colour_sums: (N, m, ``N_COLOUR_SUMS``).
        colours: of the m targets; None = no colour term.
        settings: of the score.
    """
    fits, whole = _means(sums, settings.pixels == "classes")
    if colours is None:
        return Scores(fits[0], fits[1], fits[2], whole[:, 0], whole[:, 1], whole[:, 2:])
    f_c, w = colours.fits(colour_sums), colours.weight
    score = (1 - w) * fits[0] + w * np.maximum(f_c, 0)
    return Scores(score, fits[1], fits[2], whole[:, 0], whole[:, 1], whole[:, 2:], colour_fit=f_c, colour_weight=w)


@kernel()
def _means(sums: np.ndarray, classes: bool) -> tuple[np.ndarray, np.ndarray]:
    """(3, N) score, depth fit and normal fit, and (N, 7) the counts. Compiled, as numpy takes as long to divide two
    numbers as the kernels take for a small object.
    """
    fits, whole = np.empty((3, len(sums))), np.empty((len(sums), N_SUMS - 2), np.int64)
    for i in range(len(sums)):
        for k in range(N_SUMS - 2):
            whole[i, k] = int(sums[i, 2 + k])
        n = max(sums[i, 2], 1.0)
        fits[1, i], fits[2, i] = sums[i, 0] / n, sums[i, 1] / n
        # Eq. 1: half the mean of f_d plus half the mean of f_n.
        fits[0, i] = 0.5 * (fits[1, i] + fits[2, i])
        if classes:
            seen = 1.0 - (whole[i, 2 + HIDDEN] + whole[i, 2 + UNKNOWN]) / max(whole[i, 1], 1)
            fits[0, i] *= min(1.0, seen / LEAST_SEEN_SHARE)
    return fits, whole


def score_maps(
    meshes: RenderMeshes,
    Ts_cam_obj: Float,
    at: PixelGrid,
    depth_m: NDArray[np.float32],
    faces: NDArray[np.integer],
    camera: tuple[float, float, float, float],
    prepared: PreparedTarget,
    placed_m: NDArray[np.float32],
    settings: ScoreSettings,
) -> ScoreMaps:
    """Eq. 1 pixel by pixel, from the picture of the models.

    Args:
        meshes: the m models that are drawn.
        Ts_cam_obj: (m, 4, 4).
        at: the pixels, h rows and w columns.
        depth_m: (h, w) z there [m]; 0 = empty.
        faces: (h, w) the face that is seen there, counted through all models.
        camera: (fx, fy, cx, cy) [px].
        prepared: what was observed.
        placed_m: (H, W) z of the objects placed before, (0, 0) for none [m].
        settings: of the score.
    """
    shape = depth_m.shape
    normals = np.zeros((*shape, 3), np.float32)
    difference_m, angle_rad = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    f_d, f_n = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    counted, classes = np.zeros(shape, np.bool_), np.zeros(shape, np.uint8)
    maps = normals, difference_m, angle_rad, f_d, f_n, counted, classes
    Ts, seen, rule = writable(Ts_cam_obj), prepared.arrays(placed_m), rule_of(settings)
    fill_maps(Ts, meshes.arrays, at.rows, at.columns, depth_m, faces, camera, seen, rule, maps)
    return ScoreMaps(depth_m, *maps)


def with_colours(
    maps: ScoreMaps,
    colours: SceneColours,
    sums: Float,
    Ts_cam_obj: Float,
    at: PixelGrid,
    model_of: NDArray[np.integer],
    camera: tuple[float, float, float, float],
) -> ScoreMaps:
    """The maps with those of the colour term.

    Args:
        maps: of m models.
        colours: of the models and of the image.
        sums: (m, ``N_COLOUR_SUMS``) over the whole image.
        Ts_cam_obj: (m, 4, 4).
        at: the pixels of the maps.
        model_of: (h, w) which model is seen there.
        camera: (fx, fy, cx, cy) [px].
    """
    rendered = colours.rendered(Ts_cam_obj, at, maps.rendered_m, model_of, camera)
    observed = colours.observed[at.rows[:, None], at.columns]
    explained = np.where(maps.classes == EXPLAINED + 1, model_of, -1)
    known = np.isfinite(rendered[..., :1])
    return replace(
        maps,
        observed_rgb=rgb_of(observed),
        rendered_rgb=np.where(known, rgb_of(np.where(known, rendered, 0)), 0).astype(np.uint8),
        correlation=local_correlation(rendered, observed, explained, sums),
    )
