"""Writes models of labelled objects for a BOP data set: meshes, and ``models_info.json`` with confirmed symmetries."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import read_json
from verefine_viz.core.writing import atomic, make_inside, write_json
from verefine_viz.evaluation.proposed_symmetries import ProposedSymmetry, symmetry_entry
from verefine_viz.scenes.bop_entries import model_file
from verefine_viz.scenes.image_files import write_image
from verefine_viz.scenes.meshes import Mesh, size_entry
from verefine_viz.scenes.models import ModelLibrary
from verefine_viz.scenes.unlabelled_frames import Models

INFO = "models_info.json"
Symmetries = Mapping[int, Sequence[ProposedSymmetry]]
"""Confirmed symmetries, by obj_id."""


def folder_of(models: Models) -> Path | None:
    """The folder of a BOP data set's models; None where they are single meshes."""
    return models.folder if isinstance(models, ModelLibrary) else None


def stated_infos(models: Models) -> dict[str, Any]:
    """The content of their ``models_info.json``; empty without one.

    Raises:
        InputError: it is damaged.
    """
    folder = folder_of(models)
    if folder is None or not (folder / INFO).is_file():
        return {}
    return read_json(folder / INFO, dict[str, Any])


def model_infos(models: Models, obj_ids: Iterable[int], symmetries: Symmetries) -> dict[str, Any]:
    """What ``models_info.json`` states of some objects: size and diameter, over them what it states already, over that
    the symmetries that were confirmed. What it states of others stays.

    Raises:
        InputError: a mesh or the file is damaged.
    """
    infos = stated_infos(models)
    for obj_id in obj_ids:
        model, stated = models.get(obj_id), infos.get(str(obj_id), {})
        infos[str(obj_id)] = {
            **size_entry(model.vertices, model.diameter_m),
            **stated,
            **symmetry_entry(symmetries.get(obj_id, ())),
        }
    return infos


def write_models(folder: Path, models: Models, obj_ids: Sequence[int], symmetries: Symmetries) -> None:
    """Write the meshes of some objects as PLY files in millimetres with their textures, and ``models_info.json``.

    Raises:
        InputError: a mesh is damaged, or nothing can be written.
    """
    make_inside(folder)
    for obj_id in obj_ids:
        model = models.get(obj_id)
        mesh = Mesh(model.vertices, model.faces, model.vertex_colors, (), model.texture)
        path = folder / f"obj_{obj_id:06d}.ply"
        if mesh.texture is not None:
            write_image(path.with_suffix(".png"), mesh.texture.image)
        with atomic(path) as part:
            part.write_bytes(model_file(mesh, path.with_suffix(".png")))
    infos = model_infos(models, obj_ids, symmetries)
    write_json(folder / INFO, {key: infos[key] for key in map(str, obj_ids)})


def readable(models: Models) -> tuple[list[int], list[str]]:
    """The ids of the models that can be read, and what is wrong with the others."""
    obj_ids: list[int] = []
    faults: list[str] = []
    for obj_id in models.ids:
        try:
            models.get(obj_id)
            obj_ids.append(obj_id)
        except InputError as error:
            faults.append(str(error))
    return obj_ids, faults
