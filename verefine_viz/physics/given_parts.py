"""Convex parts of a model from a file, in place of those that are worked out: what another simulator collides with."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import reading
from verefine_viz.core.model import ObjectModel
from verefine_viz.physics.colliders import HULL_TOLERANCE, Collider, lies_on, reduced_hull, solid_of

UNITS_M = (1.0, 0.01, 0.001)
"""What a unit of a file may be [m], where another than the given one would fit."""


def check_collider_folder(folder: Path) -> None:
    """Raise InputError where there is no such folder."""
    if not folder.is_dir():
        raise InputError(f"physics.collider_folder: {folder} is no folder; expected one with obj_000001.obj …")


def given_collider(model: ObjectModel, folder: Path, unit_m: float) -> Collider | None:
    """Return the collider of a model from a file such as ``obj_000005.obj``, as V-HACD and CoACD write it.

    Args:
        model: the model, of object 5.
        folder: folder of such files; each object or group of a file is a part, of which the hull counts.
        unit_m: one unit of the files [m].

    Returns:
        None where the folder has no file of the model.

    Raises:
        InputError: the folder is not there, a file cannot be read, or its parts do not lie on the model.
    """
    check_collider_folder(folder)
    path = folder / f"obj_{model.obj_id:06d}.obj"
    if not path.exists():
        return None
    with reading(path, "collider") as file:
        ways: dict[str, Any] = {"split_objects": True, "split_groups": True, "skip_materials": True, "process": False}
        meshes = trimesh.load_scene(io.BytesIO(file.read()), file_type="obj", **ways).geometry.values()
        # In an order of their own: trimesh's is not that of the file, nor is it always the same.
        parts = sorted((np.asarray(m.vertices)[np.unique(m.faces)] for m in meshes), key=lambda part: part.tolist())
        scaled = [reduced_hull(unit_m * part, HULL_TOLERANCE * model.diameter_m) for part in parts]
    if not lies_on(scaled, model):
        fits = [unit for unit in UNITS_M if lies_on([unit * part for part in parts], model)]
        reason = f"; it does with physics.collider_unit_m = {fits[0]}" if fits else ""
        raise InputError(f"collider {path} does not lie on the mesh of {model.name}{reason}")
    return solid_of(model, scaled)
