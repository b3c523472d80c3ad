"""From sums over pixels to scores, and from a picture of the model to score maps: the same for every renderer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import PixelGrid, ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering import kernels
from verefine_viz.rendering.kernels import HIDDEN, N_SUMS, UNKNOWN
from verefine_viz.rendering.map_kernel import fill_maps
from verefine_viz.rendering.mesh import RenderMeshes
from verefine_viz.rendering.prepared import PreparedTarget

PIXELS = {"published": kernels.PUBLISHED, "observed": kernels.OBSERVED, "classes": kernels.CLASSES}
"""The renderers' code of ``ScoreSettings.pixels``."""

NOTHING_PLACED = np.zeros((0, 0), np.float32)
"""z of the objects placed before, where there are none."""

LEAST_JUDGED_SHARE = 0.1
"""``classes``: a pose of whose pixels fewer than this share can be judged (neither hidden nor unmeasured) has its score
lowered in proportion, so that no pose can hide where nothing was measured. docs/methods.md 1.9."""


def as_poses(Ts_cam_obj: Float) -> Float:
    """The poses as a contiguous (N, 4, 4) array.

    Raises:
        ShapeError: another shape. NaN is let through: such a pose scores 0.
    """
    Ts = np.ascontiguousarray(Ts_cam_obj, dtype=np.float64)
    if Ts.ndim != 3 or Ts.shape[1:] != (4, 4):
        raise ShapeError(f"the poses to score have shape {Ts.shape}, expected n×4×4")
    return Ts


def as_combinations(Ts_cam_obj: Float, n_targets: int) -> Float:
    """The combinations of poses as a contiguous (N, m, 4, 4) array.

    Raises:
        ShapeError: another shape, or no target. NaN is let through: such a pose shows nothing.
    """
    Ts = np.ascontiguousarray(Ts_cam_obj, dtype=np.float64)
    if n_targets == 0:
        raise ShapeError("a scene of no targets cannot be scored, expected at least one")
    if Ts.ndim != 4 or Ts.shape[1:] != (n_targets, 4, 4):
        raise ShapeError(f"the combinations to score have shape {Ts.shape}, expected n×{n_targets}×4×4")
    return Ts


def in_order(targets: Sequence[Target], Ts: Float) -> tuple[tuple[Target, ...], Float]:
    """Targets and their poses (N, m, 4, 4) by instance: the answer is then the same, to the bit, in any order."""
    order = sorted(range(len(targets)), key=lambda k: targets[k].instance.instance_id)
    return tuple(targets[k] for k in order), np.ascontiguousarray(Ts[:, order])


def scores_from_sums(sums: Float, settings: ScoreSettings) -> Scores:
    """Scores of N poses from their sums (N, ``N_SUMS``)."""
    fits, whole = _means(sums, settings.pixels == "classes")
    return Scores(fits[0], fits[1], fits[2], whole[:, 0], whole[:, 1], whole[:, 2:])


@njit(cache=True)
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
            judged = 1.0 - (whole[i, 2 + HIDDEN] + whole[i, 2 + UNKNOWN]) / max(whole[i, 1], 1)
            fits[0, i] *= min(1.0, judged / LEAST_JUDGED_SHARE)
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
        at: the pixels that are looked at, h rows and w columns.
        depth_m: (h, w) z there [m]; 0 = empty.
        faces: (h, w) the face that is seen there, counted through all models.
        camera: (fx, fy, cx, cy) [px].
        prepared: what was observed.
        placed_m: (H, W) z of the objects placed before, (0, 0) for none [m].
        settings: how to judge.
    """
    shape = depth_m.shape
    normals = np.zeros((*shape, 3), np.float32)
    difference_m, angle_rad = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    f_d, f_n = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    counted, classes = np.zeros(shape, np.bool_), np.zeros(shape, np.uint8)
    fill_maps(
        np.ascontiguousarray(Ts_cam_obj),
        meshes.face_normals,
        meshes.face_starts,
        at.rows,
        at.columns,
        depth_m,
        faces,
        camera,
        prepared.observed,
        prepared.flags,
        prepared.own,
        placed_m,
        PIXELS[settings.pixels],
        settings.tau_m,
        settings.alpha,
        normals,
        difference_m,
        angle_rad,
        f_d,
        f_n,
        counted,
        classes,
    )
    return ScoreMaps(depth_m, normals, difference_m, angle_rad, f_d, f_n, counted, classes)
