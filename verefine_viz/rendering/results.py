"""From sums over pixels to scores, and from a picture of the model to score maps: the same for every renderer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.problem import Target
from verefine_viz.core.scores import ScoreMaps, Scores
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering import kernels
from verefine_viz.rendering.kernels import EXPLAINED, HIDDEN, MISSED, OBJECTS, OWN, PROTRUDING, UNKNOWN
from verefine_viz.rendering.mesh import RenderMeshes
from verefine_viz.rendering.prepared import PreparedTarget

PIXELS = {"published": kernels.PUBLISHED, "observed": kernels.OBSERVED, "classes": kernels.CLASSES}
"""The renderers' code of ``ScoreSettings.pixels``."""

LEAST_JUDGED_SHARE = 0.1
"""``classes``: a pose of whose pixels fewer than this share can be judged (neither hidden nor unmeasured) has its score
lowered in proportion, so that no pose can hide where nothing was measured. METHODS 1.9."""


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
    n = np.maximum(sums[:, 2], 1.0)
    depth_fit, normal_fit = sums[:, 0] / n, sums[:, 1] / n
    score = 0.5 * (depth_fit + normal_fit)
    whole = sums[:, 2:].astype(np.int64)
    counts = whole[:, 2:]
    if settings.pixels == "classes":
        rendered = np.maximum(whole[:, 1], 1)
        judged = 1.0 - (counts[:, HIDDEN] + counts[:, UNKNOWN]) / rendered
        score = score * np.minimum(1.0, judged / LEAST_JUDGED_SHARE)
    return Scores(score, depth_fit, normal_fit, whole[:, 0], whole[:, 1], counts)


def normals_image(
    meshes: RenderMeshes,
    Ts_cam_obj: Float,
    depth_m: NDArray[np.float32],
    face_of: NDArray[np.integer],
    camera: tuple[float, float, float, float],
) -> NDArray[np.float32]:
    """Unit face normals (H, W, 3) in the camera frame, towards the camera; 0 where ``depth_m`` is 0.

    Args:
        meshes: the m models that are drawn.
        Ts_cam_obj: (m, 4, 4).
        depth_m: (H, W) z [m].
        face_of: (H, W) the face that is seen, counted through all models.
        camera: (fx, fy, cx, cy) [px].
    """
    fx, fy, cx, cy = camera
    out = np.zeros((*depth_m.shape, 3), np.float32)
    box = _box(depth_m != 0)
    rows, columns = np.nonzero(depth_m[box])
    rows, columns = rows + box[0].start, columns + box[1].start
    face = face_of[rows, columns]
    model = meshes.model_of(face)
    normals = np.empty((len(rows), 3))
    for k, T in enumerate(Ts_cam_obj):
        normals[model == k] = meshes.face_normals[face[model == k]] @ T[:3, :3].T
    rays = np.stack([(columns - cx) / fx, (rows - cy) / fy, np.ones(len(rows))], axis=1)
    away = np.einsum("ij,ij->i", normals, rays) > 0
    out[rows, columns] = np.where(away[:, None], -normals, normals)
    return out


def score_maps(
    rendered_m: NDArray[np.float32],
    rendered_normals: NDArray[np.float32],
    model_of: NDArray[np.integer],
    prepared: PreparedTarget,
    placed_m: NDArray[np.float32] | None,
    settings: ScoreSettings,
) -> ScoreMaps:
    """Eq. 1 pixel by pixel, from the picture of the model.

    Args:
        rendered_m: (H, W) z [m]; 0 = empty.
        rendered_normals: (H, W, 3) unit, towards the camera.
        model_of: (H, W) index of the model that is seen.
        prepared: what was observed.
        placed_m: (H, W) z of the objects placed before; None = none [m].
        settings: how to judge.
    """
    shape = rendered_m.shape
    own = (prepared.flags & OWN) != 0
    counted = (prepared.flags & OBJECTS) != 0 if settings.pixels == "published" else own.copy()
    difference_m, angle_rad = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    f_d, f_n = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    classes = np.zeros(shape, np.uint8)
    # Away from the picture and the mask nothing is to be computed, and most of the image is away from both.
    box = _box((rendered_m > 0) | own)
    seen_own = np.take_along_axis(prepared.own[:, *box], model_of[box][None], axis=0)[0]
    maps = _maps_within(
        rendered_m[box],
        rendered_normals[box],
        prepared.observed[box],
        prepared.flags[box],
        (seen_own & OWN) != 0,
        None if placed_m is None else placed_m[box],
        settings,
    )
    for whole, part in zip((difference_m, angle_rad, f_d, f_n, counted, classes), maps, strict=True):
        whole[box] = part
    return ScoreMaps(rendered_m, rendered_normals, difference_m, angle_rad, f_d, f_n, counted, classes)


def _maps_within(
    rendered_m, rendered_normals, observed_and_normals, flags, seen_own, placed_m, settings: ScoreSettings
):
    """Difference [m], angle [rad], f_d, f_n, counted and classes for a part of the image."""
    observed, normals = observed_and_normals[:, :, 3], observed_and_normals[:, :, :3]
    drawn, measured = rendered_m > 0, observed > 0
    has_normal = (normals != 0).any(axis=2)
    own, objects = (flags & OWN) != 0, (flags & OBJECTS) != 0
    difference = observed.astype(np.float64) - rendered_m
    dot = np.clip(np.einsum("hwk,hwk->hw", normals, rendered_normals, dtype=np.float64), 0.0, 1.0)
    classes = _classes(difference, drawn, measured, own, seen_own, observed, rendered_m, placed_m, settings.tau_m)

    if settings.pixels == "published":
        fits, counted = drawn & objects, drawn | objects
    elif settings.pixels == "observed":
        fits, counted = drawn & own, own
    else:
        fits = classes == EXPLAINED + 1
        counted = fits | (classes == MISSED + 1) | (classes == PROTRUDING + 1)
    f_d = np.where(fits, np.maximum(0.0, 1.0 - np.abs(difference) / settings.tau_m), 0.0)
    f_n = np.where(fits, np.maximum(0.0, 1.0 - (1.0 - dot) / settings.alpha), 0.0)
    if settings.pixels != "published":
        f_n = np.where(has_normal, f_n, f_d)
    shown_difference = np.where(drawn & measured, difference, np.nan)
    angle = np.where(drawn & has_normal, np.arccos(dot), np.nan)
    return shown_difference, angle, f_d, f_n, counted, classes


def _box(here: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The smallest rectangle around what is True; an empty one where nothing is."""
    rows = np.flatnonzero(here.any(axis=1))
    if len(rows) == 0:
        return slice(0, 0), slice(0, 0)
    columns = np.flatnonzero(here[rows[0] : rows[-1] + 1].any(axis=0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _classes(difference, drawn, measured, own, seen_own, observed, rendered_m, placed_m, tau) -> NDArray[np.uint8]:
    near = np.abs(difference) < tau
    explained_by_other = np.zeros_like(drawn)
    if placed_m is not None:
        explained_by_other = (placed_m > 0) & (placed_m < rendered_m) & (np.abs(observed - placed_m) < tau)
    judged = drawn & measured
    free = judged & ~near & (difference > 0)
    rest = judged & ~free & ~(near & seen_own)
    out = np.zeros(drawn.shape, np.uint8)
    out[own & ~drawn] = MISSED + 1
    out[drawn & ~measured] = UNKNOWN + 1
    out[judged & near & seen_own] = EXPLAINED + 1
    out[free] = PROTRUDING + 1
    out[rest & ~near] = HIDDEN + 1
    out[rest & own] = MISSED + 1
    out[rest & near] = PROTRUDING + 1
    out[rest & explained_by_other] = HIDDEN + 1
    return out
