"""What is learnt of a model once: all its point pairs by their feature, in which votes are looked up, and its distance
field. Cached on disk by the hash of the mesh.
"""

from __future__ import annotations

import hashlib
import io
import logging
import math
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import platformdirs
from numpy.typing import NDArray

from verefine_viz.core.algorithm_settings import PpfSettings
from verefine_viz.core.array_cache import NPZ_READING
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.files import reading
from verefine_viz.core.kernels import kernel
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.writing import atomic
from verefine_viz.estimators.clouds import Oriented, model_surface, thinned_surface
from verefine_viz.estimators.ppf_agreement import SurfaceField, surface_field

log = logging.getLogger(__name__)

FORMAT = 1
"""Part of the cache's file names; raise it when the same model and settings would give other tables."""

LEARNT_FROM = ("step", "distance_bin", "angle_bin_deg", "bin_limit", "seed")
"""The settings that a table depends on."""

AT_ONCE = 100
"""First points whose pairs are made between two checkpoints: a tenth of a second."""


class FeatureTable(NamedTuple):
    """The pairs of one model, bin by bin."""

    points: Float
    """(M, 3) thinned model points, object frame [m]."""
    normals: Float
    """(M, 3) their outward normals."""
    rotations: Float
    """(M, 3, 3) that turn each normal onto +x."""
    starts: NDArray[np.int64]
    """(bins + 1,) where the pairs of each bin begin."""
    weights: NDArray[np.float32]
    """(bins,) for how many pairs each one in the bin stands: 1, or more where only some are used."""
    first: NDArray[np.uint16]
    """(pairs,) the pair's first point."""
    turn_rad: NDArray[np.float32]
    """(pairs,) angle of the pair's second point about the first one's normal [rad]."""
    distance_bin_m: float
    angle_bin_rad: float
    n_distances: int
    n_angles: int


class PpfModel(NamedTuple):
    """The data needed to find a model."""

    table: FeatureTable
    field: SurfaceField

    @property
    def cloud(self) -> Oriented:
        """The thinned surface, object frame."""
        return Oriented(self.table.points, self.table.normals)


def learn(model: ObjectModel, settings: PpfSettings, progress: ProgressToken = NEVER_CANCELLED) -> PpfModel:
    """Tables of ``model``, without the cache: a tenth to half a second, several on the finest grid.

    Raises:
        Cancelled: through ``progress``.
    """
    surface = model_surface(model, settings.seed)
    d = model.diameter_m
    angle_bin_rad = math.radians(settings.angle_bin_deg)
    cloud = thinned_surface(surface, settings.step * d)
    table = pair_table(cloud, settings.distance_bin * d, angle_bin_rad, settings.bin_limit, progress)
    return PpfModel(table, surface_field(surface.points, d))


def cache_folder() -> Path:
    """Where tables are cached."""
    return Path(platformdirs.user_cache_dir("verefine-viz")) / "ppf"


def cache_file(model: ObjectModel, settings: PpfSettings, folder: Path | None = None) -> Path:
    """The cached file of this model's tables for these settings; ``folder`` None = :func:`cache_folder`."""
    facts = repr((model.diameter_m, *(getattr(settings, name) for name in LEARNT_FROM)))
    digest = hashlib.sha256(facts.encode()).hexdigest()[:12]
    return (folder or cache_folder()) / f"{model.mesh_hash}-{digest}-v{FORMAT}.npz"


def read(path: Path) -> PpfModel | None:
    """The tables in the file ``path``; None if there are none that can be used."""
    if not os.path.lexists(path):
        return None
    try:
        with reading(path) as file, NPZ_READING, np.load(file, allow_pickle=False) as data:
            table = FeatureTable(
                data["points"],
                data["normals"],
                data["rotations"],
                data["starts"],
                data["weights"],
                data["first"],
                data["turn_rad"],
                float(data["distance_bin_m"]),
                float(data["angle_bin_rad"]),
                int(data["n_distances"]),
                int(data["n_angles"]),
            )
            learnt = PpfModel(table, SurfaceField(data["distance_m"], data["low"], float(data["side_m"])))
    except InputError as error:
        log.warning("the table is damaged and made again: %s", error)
        return None
    if not _is_sound(learnt):
        log.warning("the table %s is damaged and made again", path.name)
        return None
    return learnt


def write(path: Path, learnt: PpfModel) -> None:
    """Writes the tables to ``path``; a cache that cannot be written only costs time."""
    buffer = io.BytesIO()
    np.savez(buffer, **learnt.table._asdict(), **learnt.field._asdict())
    try:
        with atomic(path) as part:
            part.write_bytes(buffer.getvalue())
    except InputError as error:
        log.warning("the table is not cached: %s", error)


def _is_sound(learnt: PpfModel) -> bool:
    """Whether compiled loops stay inside the arrays of a table from the cache."""
    t, f = learnt
    n_points, n_bins, n_pairs = len(t.points), t.n_distances * t.n_angles**3, len(t.first)
    shapes = [(n_points, 3), (n_points, 3), (n_points, 3, 3), (n_bins + 1,), (n_bins,), (n_pairs,), (n_pairs,)]
    dtypes = [np.float64, np.float64, np.float64, np.int64, np.float32, np.uint16, np.float32]
    if any(a.shape != s or a.dtype != d for a, s, d in zip(t[:7], shapes, dtypes, strict=True)):
        return False
    if f.distance_m.ndim != 3 or f.distance_m.dtype != np.float32 or f.low.shape != (3,) or f.low.dtype != np.float64:
        return False
    in_order = t.starts[0] == 0 and t.starts[-1] == n_pairs and (np.diff(t.starts) >= 0).all()
    finite = all(np.isfinite(a).all() for a in (t.points, t.normals, t.rotations, t.weights, t.turn_rad, f.distance_m))
    sizes = min(t.distance_bin_m, t.angle_bin_rad, f.side_m) > 0
    return bool(in_order and finite and sizes and n_pairs > 0 and t.first.max() < n_points)


def pair_table(
    cloud: Oriented,
    distance_bin_m: float,
    angle_bin_rad: float,
    bin_limit: int,
    progress: ProgressToken = NEVER_CANCELLED,
) -> FeatureTable:
    """The table of a thinned model cloud.

    Args:
        cloud: (M, 3) points and outward normals, M < 65536.
        distance_bin_m: bin of the distance [m].
        angle_bin_rad: bin of each of the three angles [rad].
        bin_limit: most pairs used of a bin, evenly spread over its pairs in order of their points; flat faces fill few
            bins with very many pairs, which would take nearly all of the time.
        progress: asked on the way; the finest table of a large model takes seconds.

    Raises:
        Cancelled: through ``progress``.
    """
    points, normals = cloud
    n_angles = int(np.pi / angle_bin_rad) + 1
    n_distances = int(np.linalg.norm(np.ptp(points, axis=0)) / distance_bin_m) + 1
    rotations = np.stack([local_rotation(n) for n in normals])
    n = len(points)
    key = np.empty(n * (n - 1), dtype=np.int64)
    first = np.empty(n * (n - 1), dtype=np.uint16)
    turn = np.empty(n * (n - 1), dtype=np.float32)
    for begin in progress.over(range(0, n, AT_ONCE)):
        end = min(begin + AT_ONCE, n)
        _pairs(points, normals, rotations, distance_bin_m, angle_bin_rad, n_angles, begin, end, key, first, turn)
    sizes = np.bincount(key, minlength=n_distances * n_angles**3)
    progress.checkpoint()
    before = np.concatenate([[0], np.cumsum(sizes)])
    order = _group_by_bin(key, before)
    progress.checkpoint()
    n_used = np.minimum(sizes, bin_limit)
    starts = np.concatenate([[0], np.cumsum(n_used)])
    # The m-th pair used of a bin is number ⌊m · size / n_used⌋ of it.
    of_bin = np.repeat(np.arange(len(sizes)), n_used)
    within = np.arange(len(of_bin)) - starts[of_bin]
    order = order[before[of_bin] + within * sizes[of_bin] // n_used[of_bin]]
    weights = (sizes / np.maximum(n_used, 1)).astype(np.float32)
    return FeatureTable(
        points, normals, rotations, starts, weights, first[order], turn[order],
        distance_bin_m, angle_bin_rad, n_distances, n_angles,
    )  # fmt: skip


@kernel()
def bin_of(
    feature: tuple[float, float, float, float], distance_bin_m: float, angle_bin_rad: float, n_angles: int
) -> int:
    """Index of the bin that a feature falls into."""
    distance_m, at_first, at_second, between = feature
    key = int(distance_m / distance_bin_m) * n_angles + int(at_first / angle_bin_rad)
    return (key * n_angles + int(at_second / angle_bin_rad)) * n_angles + int(between / angle_bin_rad)


@kernel()
def _pairs(
    points: np.ndarray,
    normals: np.ndarray,
    rotations: np.ndarray,
    distance_bin_m: float,
    angle_bin_rad: float,
    n_angles: int,
    begin: int,
    end: int,
    key: np.ndarray,
    first: np.ndarray,
    turn: np.ndarray,
) -> None:
    """Enters bin, first point and turn of every ordered pair of different points whose first is one of begin … end."""
    n = len(points)
    k = begin * (n - 1)
    for i in range(begin, end):
        for j in range(n):
            if i != j:
                feature = pair_feature(points[i], normals[i], points[j], normals[j])
                key[k] = bin_of(feature, distance_bin_m, angle_bin_rad, n_angles)
                first[k] = i
                turn[k] = turn_about_normal(rotations[i], points[i], points[j])
                k += 1


@kernel()
def _group_by_bin(key: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """The pairs, as indices, bin by bin and in their order within each; ``starts`` is where each bin begins."""
    cursor = starts.copy()
    order = np.empty(len(key), dtype=np.int64)
    for k in range(len(key)):
        order[cursor[key[k]]] = k
        cursor[key[k]] += 1
    return order


@kernel()
def angle(cosine: float) -> float:
    """The angle of a cosine that rounding may have pushed beyond 1 [rad]; π for NaN, as the angle becomes an index."""
    return np.arccos(min(1.0, max(-1.0, cosine)))  # In this order: NaN is not larger than −1.


@kernel()
def pair_feature(p1: np.ndarray, n1: np.ndarray, p2: np.ndarray, n2: np.ndarray) -> tuple[float, float, float, float]:
    """Distance [m] and the angles n1-d, n2-d, n1-n2 [rad], where d points from the first to the second."""
    x, y, z = p2[0] - p1[0], p2[1] - p1[1], p2[2] - p1[2]
    distance = np.sqrt(x * x + y * y + z * z)
    if distance == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    return (
        distance,
        angle((n1[0] * x + n1[1] * y + n1[2] * z) / distance),
        angle((n2[0] * x + n2[1] * y + n2[2] * z) / distance),
        angle(n1[0] * n2[0] + n1[1] * n2[1] + n1[2] * n2[2]),
    )


@kernel()
def local_rotation(normal: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that turns ``normal`` onto +x; which one of the many is fixed by the normal alone."""
    x, y, z = normal[0], normal[1], normal[2]
    # Duff et al. 2017: an orthonormal basis without a singular direction.
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[x, y, z], [1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]])


@kernel()
def turn_about_normal(rotation: np.ndarray, p1: np.ndarray, p2: np.ndarray) -> float:
    """The angle of ``p2`` about the x axis of p1's local frame [rad], in (-π, π]."""
    x, y, z = p2[0] - p1[0], p2[1] - p1[1], p2[2] - p1[2]
    return np.arctan2(
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
    )


@kernel()
def pose_of_match(
    p_cam: np.ndarray, rotation_cam: np.ndarray, p_obj: np.ndarray, rotation_obj: np.ndarray, turn_rad: float
) -> np.ndarray:
    """``T_cam_obj`` (4, 4) that lays p_obj and its normal on p_cam and its normal, turned about them."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    R = rotation_cam.T @ about_x @ rotation_obj
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = p_cam - R @ p_obj
    return T
