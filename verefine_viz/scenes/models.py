"""Object models of a BOP folder: geometry, names, symmetries, and the cloud that refiners register against."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import trimesh
from msgspec import Meta

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError, one_line, quoted, unknown
from verefine_viz.core.files import Numbered, Numbers3, Numbers4x4, id_of, read_json
from verefine_viz.core.geometry import as_rigid, axis_angle, check_reach, transform
from verefine_viz.core.model import CONTINUOUS_STEPS, ObjectModel
from verefine_viz.core.settings import ModelSampling
from verefine_viz.core.text_format import MOST_NAMED, first_of, listed, unusable
from verefine_viz.estimators.clouds import spread_out
from verefine_viz.scenes.bop_files import nearby_hint
from verefine_viz.scenes.meshes import Mesh, mesh_files, read_mesh, unit_of_format

# An object's entry in ``models_info.json``.


class SymmetryAxis(msgspec.Struct, frozen=True):
    """A continuous symmetry."""

    axis: Numbers3
    """Axis, of any length."""
    offset: Numbers3
    """A point of it [mm]."""


class ModelInfo(msgspec.Struct, frozen=True):
    """An object's entry in models_info.json, in millimetres."""

    diameter: Annotated[float, Meta(ge=1e-3, le=1e6)] | None = None
    symmetries_discrete: tuple[Numbers4x4, ...] = ()
    symmetries_continuous: tuple[SymmetryAxis, ...] = ()


def symmetry_transforms(info: ModelInfo, where: str, continuous_steps: int = CONTINUOUS_STEPS) -> Float:
    """All transforms (S, 4, 4) [m] of the object frame that leave the object looking the same; the identity first.

    Args:
        info: the object's entry of models_info.json.
        where: what to call the entry in an error.
        continuous_steps: rotations per continuous axis.

    Raises:
        InputError: an entry is no rigid transform, or no direction.
    """
    discrete, continuous = listed_symmetries(info, where, continuous_steps, 1e-3)
    try:
        rigid = [as_rigid(T, f"{where}: symmetries_discrete[{k}]") for k, T in enumerate(discrete)]
    except ShapeError as error:
        raise InputError(str(error)) from None
    return combined_symmetries(rigid, continuous)


def listed_symmetries(
    info: ModelInfo, where: str, continuous_steps: int, unit: float
) -> tuple[list[Float], list[Float]]:
    """The discrete symmetries (4, 4) with the digits of the file, and the steps of all continuous ones.

    Args:
        info: the object's entry of models_info.json.
        where: what to call the entry in an error.
        continuous_steps: rotations per continuous axis.
        unit: of the result's translations, per millimetre.

    Raises:
        InputError: an axis is no direction, or a position is out of reach.
    """
    try:
        discrete = [
            _scaled(T, unit, f"{where}: symmetries_discrete[{k}]") for k, T in enumerate(info.symmetries_discrete)
        ]
        continuous = [
            T
            for k, axis in enumerate(info.symmetries_continuous)
            for T in _rotations(axis, f"{where}: symmetries_continuous[{k}]", continuous_steps, unit)
        ]
    except ShapeError as error:
        raise InputError(str(error)) from None
    return discrete, continuous


def _scaled(T_mm: Float, unit: float, where: str) -> Float:
    check_reach(T_mm[:3, 3] * 1e-3, where)
    T = T_mm.copy()
    T[:3, 3] *= unit
    return T


def combined_symmetries(discrete: Sequence[Float], continuous: Sequence[Float]) -> Float:
    """All C·D (S, 4, 4) of discrete transforms D, the identity before them, and the steps C of continuous ones.

    Several continuous axes are put one after another, not multiplied. Source: the official BOP toolkit.
    """
    every = [np.eye(4), *discrete]
    return np.stack([C @ D for D in every for C in continuous] if continuous else every)


def _rotations(symmetry: SymmetryAxis, where: str, n_steps: int, unit: float) -> list[Float]:
    if not np.linalg.norm(symmetry.axis) > 0:
        raise ShapeError(f"{where}: 'axis' is zero, expected a direction")
    check_reach(symmetry.offset * 1e-3, f"{where}: 'offset'")
    offset = symmetry.offset * unit
    turns = (axis_angle(symmetry.axis, 2 * np.pi * i / n_steps) for i in range(n_steps))
    return [transform(R, offset - R @ offset) for R in turns]


# The unit of a mesh file, checked against the diameter that models_info.json states for the object.

SIZE_TOLERANCE = 1.2
"""Ratio between a mesh's own and its stated diameter above which there is a note."""

LONGEST_NAME = 200
"""Length of an object's name [characters]."""
DRAWN_FOR_EVEN = 5
"""Points drawn at random for each one of an evenly spread cloud. 2000 of these take 0.02 s, 20 000 a hundred times as
long."""


def checked_unit(file: str, own_m: float, stated_m: float | None) -> tuple[float, str]:
    """What a mesh must be multiplied by, and a note about its size (empty = none).

    1000 where its size says that its unit is metres and was read as millimetres, 0.001 for the reverse, else 1.

    Args:
        file: name of the mesh file.
        own_m: the mesh's diameter, in the unit that its format stands for [m].
        stated_m: the object's diameter by models_info.json [m]; None = it states none.
    """
    if stated_m is None:
        if 0.002 < own_m < 20:
            return 1.0, ""
        return 1.0, f"{file} is {own_m * 1e3:.4g} mm across; check its unit (models_info.json states no diameter)"
    if own_m == 0 or 1 / SIZE_TOLERANCE < own_m / stated_m < SIZE_TOLERANCE:
        return 1.0, ""
    contradiction = f"{file} is {own_m * 1e3:.4g} mm across, models_info.json says {stated_m * 1e3:.4g} mm"
    for factor, unit in ((1000.0, "metres"), (0.001, "millimetres")):
        if 1 / SIZE_TOLERANCE < own_m * factor / stated_m < SIZE_TOLERANCE:
            return factor, f"{contradiction}: its unit was taken to be {unit}"
    return 1.0, f"{contradiction}; one of them is wrong"


def model_of_mesh(
    mesh: Mesh,
    obj_id: int,
    name: str,
    n_points: int,
    seed: int,
    symmetries: Float | None = None,
    diameter_m: float | None = None,
    sampling: ModelSampling = "random",
) -> ObjectModel:
    """The model of a mesh.

    Args:
        mesh: its surface.
        obj_id: BOP id.
        name: for messages and tables.
        n_points: points to sample on the surface.
        seed: of the sampling.
        symmetries: (S, 4, 4) [m], identity first; None = the identity only.
        diameter_m: stated diameter; None = measured on the mesh.
        sampling: how the points are spread.

    Raises:
        InputError: the mesh has no surface.
    """
    triangles = mesh.vertices_m[mesh.faces]
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    double_area = np.linalg.norm(cross, axis=1)
    if not double_area.sum() > 0:
        raise InputError(f"the mesh of object {obj_id} ({name}) has no surface: all its triangles are degenerate")
    shape = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)
    n_drawn = n_points if sampling == "random" else DRAWN_FOR_EVEN * n_points
    points, face_of_point = trimesh.sample.sample_surface(shape, n_drawn, face_weight=double_area, seed=seed)[:2]
    if sampling == "even":
        chosen, _ = spread_out(points, n_points)
        points, face_of_point = points[chosen], face_of_point[chosen]
    normals = cross[face_of_point] / double_area[face_of_point, None]
    return ObjectModel(
        obj_id,
        name,
        mesh.vertices_m,
        mesh.faces,
        points,
        normals,
        mesh.diameter_m if diameter_m is None else diameter_m,
        np.eye(4)[None] if symmetries is None else symmetries,
        mesh.vertex_colors,
        mesh.texture,
    )


class ModelLibrary:
    """The models of one data set, each read once, when it is first asked for.

    Args:
        dataset: the data set's folder; models are in ``models``, else ``models_eval``, any ``models_*``, or in it.
        n_points: points to sample on each model.
        seed: of the sampling.
        sampling: how the points are spread.

    Raises:
        InputError: no folder of models, or its JSON files are damaged.
    """

    def __init__(self, dataset: Path, n_points: int, seed: int, sampling: ModelSampling = "random") -> None:
        self.folder = _models_folder(dataset)
        self._n_points = n_points
        self._seed = seed
        self._sampling: ModelSampling = sampling
        infos = self.folder / "models_info.json"
        self._infos = Numbered(infos, ModelInfo, "object") if os.path.lexists(infos) else {}
        self._names, faults = _names(dataset, self.folder)
        self.faults: tuple[str, ...] = unusable("name", "obj_names.json", faults)
        """About what of all models cannot be used."""
        if isinstance(self._infos, Numbered):
            self.faults += unusable("entry", "models_info.json", self._infos.faults)
        self._loaded: dict[int, tuple[ObjectModel, tuple[str, ...]]] = {}
        self._meshes = mesh_files(self.folder)
        self.ids: tuple[int, ...] = tuple(self._meshes)
        """BOP ids of the models whose mesh file is there."""

    def name(self, obj_id: int) -> str:
        """The object's name: of ``obj_names.json`` where there is one, else ``obj_000005``."""
        return self._names.get(obj_id, f"obj_{obj_id:06d}")

    def get(self, obj_id: int) -> ObjectModel:
        """The model of an object.

        Raises:
            InputError: there is none, or its file or its entry in models_info.json is damaged.
        """
        return self._load(obj_id)[0]

    def notes(self, obj_id: int) -> tuple[str, ...]:
        """Notes about the model: units guessed, texture missing, …"""
        return self._load(obj_id)[1]

    def shifted_note(self, obj_ids: Collection[int], of: str) -> tuple[str, ...]:
        """A note where object ids that a file (``of``) uses seem to count from 0: all are one less than a model's."""
        if not obj_ids or min(obj_ids) != 0 or 0 in self.ids or not {i + 1 for i in obj_ids} <= {*self.ids}:
            return ()
        there = f"its object ids are {listed(sorted(obj_ids))}, those of models {listed(self.ids)}"
        return (f"{of}: {there}; where it counts from 0, all are one too small: add 1 to each",)

    def _load(self, obj_id: int) -> tuple[ObjectModel, tuple[str, ...]]:
        if obj_id not in self._loaded:
            self._loaded[obj_id] = self._read(obj_id)
        return self._loaded[obj_id]

    def _read(self, obj_id: int) -> tuple[ObjectModel, tuple[str, ...]]:
        if obj_id not in self._meshes:
            near = nearby_hint(self.folder / f"obj_{obj_id:06d}.ply")
            raise InputError(f"{unknown('model', obj_id, self.ids)} in {self.folder}{near}")
        path = self._meshes[obj_id]
        where = f"{self.folder / 'models_info.json'}, object {obj_id}"
        info = self._infos[obj_id] if obj_id in self._infos else ModelInfo()
        stated_m = None if info.diameter is None else info.diameter * 1e-3
        symmetries = symmetry_transforms(info, where)
        mesh = read_mesh(path, unit_of_format(path))
        factor, note = checked_unit(path.name, mesh.diameter_m, stated_m)
        if factor != 1.0:
            mesh = replace(mesh, vertices_m=mesh.vertices_m * factor)
        model = model_of_mesh(
            mesh, obj_id, self.name(obj_id), self._n_points, self._seed, symmetries, stated_m, self._sampling
        )
        notes = mesh.notes + ((note,) if note else ())
        return model, tuple(f"{self.name(obj_id)} ({obj_id}): {note}" for note in notes)


def _models_folder(dataset: Path) -> Path:
    names = ["models", "models_eval", *sorted(p.name for p in dataset.glob("models_*") if p.is_dir())]
    for name in names:
        if any((dataset / name).glob("obj_*")):
            return dataset / name
    if dataset.is_dir() and mesh_files(dataset):
        return dataset
    raise InputError(
        f"{dataset} has no object models; expected models/obj_000001.ply, … (or models_eval/){models_beside(dataset)}"
    )


def models_beside(dataset: Path) -> str:
    """A hint at what may be meant where a data set has no folder of models; empty where nothing is like one."""
    folder = dataset / "models"
    there = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else ()
    return f"; models/ holds {first_of(there, MOST_NAMED)}" if there else nearby_hint(folder)


def _names(dataset: Path, models: Path) -> tuple[dict[int, str], list[str]]:
    """Names by obj_id, and what is wrong with those that are left out."""
    path = next((f / "obj_names.json" for f in (models, dataset) if os.path.lexists(f / "obj_names.json")), None)
    if path is None:
        return {}, []
    names: dict[int, str] = {}
    faults: list[str] = []
    for key, value in read_json(path, dict[str, str | int | None]).items():
        # Both directions are in use: {"1": "can"} and {"can": 1}.
        number, name = (key, value) if id_of(key) is not None else (value, key)
        obj_id = id_of(str(number))
        # Names go into tables and files, which hold neither line breaks nor half characters (lone surrogates).
        shown = one_line(str(name))
        if obj_id is None:
            faults.append(f"{quoted(key, 40)}: {quoted(value, 40)} does not name an object id")
        elif obj_id in names:
            faults.append(f"object {obj_id} is named twice, of which the first counts")
        elif not 0 < len(shown) <= LONGEST_NAME:
            faults.append(f"the name of object {obj_id} has {len(shown)} characters, expected 1 to {LONGEST_NAME}")
        else:
            names[obj_id] = shown
    return names, faults
