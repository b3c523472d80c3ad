"""What is learnt of a model once: pair table and distance field, kept on disk by the hash of the mesh."""

from __future__ import annotations

import hashlib
import io
import logging
import math
import os
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import platformdirs

from verefine_viz.core.algorithm_settings import PpfSettings
from verefine_viz.core.errors import InputError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.paths import atomic, read_input
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.estimators.ppf_agreement import SurfaceField, surface_field
from verefine_viz.estimators.ppf_cloud import Oriented, model_surface, thinned
from verefine_viz.estimators.ppf_table import PairTable, pair_table

log = logging.getLogger(__name__)

FORMAT = 1
"""Part of the cache's file names; raise it when the same model and settings would give other tables."""

LEARNT_FROM = ("step", "distance_bin", "angle_bin_deg", "bin_limit", "seed")
"""The settings that a table depends on."""


class Learnt(NamedTuple):
    """All that is needed of a model to find it."""

    table: PairTable
    field: SurfaceField

    @property
    def cloud(self) -> Oriented:
        """The thinned surface, object frame."""
        return Oriented(self.table.points, self.table.normals)


def learn(model: ObjectModel, settings: PpfSettings, progress: ProgressToken = NEVER_CANCELLED) -> Learnt:
    """Tables of ``model``, without the cache: a tenth to half a second, several on the finest grid.

    Raises:
        Cancelled: nobody waits for them any more.
    """
    surface = model_surface(model, settings.seed)
    d = model.diameter_m
    angle_bin_rad = math.radians(settings.angle_bin_deg)
    cloud = thinned(surface, settings.step * d)
    table = pair_table(cloud, settings.distance_bin * d, angle_bin_rad, settings.bin_limit, progress)
    return Learnt(table, surface_field(surface.points, d))


def cache_folder() -> Path:
    """Where tables are kept."""
    return Path(platformdirs.user_cache_dir("verefine-viz")) / "ppf"


def cache_file(model: ObjectModel, settings: PpfSettings, folder: Path | None = None) -> Path:
    """The file that keeps this model's tables for these settings; ``folder`` None = :func:`cache_folder`."""
    facts = repr((model.diameter_m, *(getattr(settings, name) for name in LEARNT_FROM)))
    digest = hashlib.sha256(facts.encode()).hexdigest()[:12]
    return (folder or cache_folder()) / f"{model.mesh_hash}-{digest}-v{FORMAT}.npz"


def read(path: Path) -> Learnt | None:
    """The tables kept at ``path``; None if there are none that can be used."""
    if not os.path.lexists(path):
        return None
    try:
        with np.load(io.BytesIO(read_input(path)), allow_pickle=False) as kept:
            table = PairTable(
                kept["points"],
                kept["normals"],
                kept["rotations"],
                kept["starts"],
                kept["weights"],
                kept["first"],
                kept["turn_rad"],
                float(kept["distance_bin_m"]),
                float(kept["angle_bin_rad"]),
                int(kept["n_distances"]),
                int(kept["n_angles"]),
            )
            learnt = Learnt(table, SurfaceField(kept["distance_m"], kept["low"], float(kept["side_m"])))
    except (InputError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile) as error:
        log.warning("the table %s is damaged and made again (%s)", path.name, error)
        return None
    if not _is_sound(learnt):
        log.warning("the table %s is damaged and made again", path.name)
        return None
    return learnt


def write(path: Path, learnt: Learnt) -> None:
    """Keeps the tables at ``path``; a cache that cannot be written only costs time."""
    buffer = io.BytesIO()
    np.savez(buffer, **learnt.table._asdict(), **learnt.field._asdict())
    try:
        with atomic(path) as part:
            part.write_bytes(buffer.getvalue())
    except InputError as error:
        log.warning("the table is not cached: %s", error)


def _is_sound(learnt: Learnt) -> bool:
    """Whether compiled loops can use it without leaving its arrays."""
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
