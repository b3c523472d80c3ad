"""Object models of a BOP folder: geometry, names, symmetries, and the cloud that refiners register against."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.model import ObjectModel
from verefine_viz.scenes.jsonfile import number_of, read_json
from verefine_viz.scenes.meshes import FORMATS, Mesh, read_mesh, unit_of_format
from verefine_viz.scenes.symmetries import symmetry_transforms
from verefine_viz.scenes.units import checked_unit


def load_model(
    path: Path,
    obj_id: int,
    name: str,
    unit_m: float,
    n_points: int,
    seed: int,
    symmetries: Float | None = None,
    diameter_m: float | None = None,
) -> ObjectModel:
    """One object model of a mesh file.

    Args:
        path: PLY, OBJ, GLB or STL.
        obj_id: BOP id.
        name: for people.
        unit_m: metres per unit of the file (BOP: 1e-3).
        n_points: points to sample on the surface.
        seed: of the sampling.
        symmetries: (S, 4, 4) [m], identity first; None = the identity only.
        diameter_m: stated diameter; None = measured on the mesh.

    Raises:
        InputError: the file is missing, damaged, or holds no triangles.
    """
    return model_of_mesh(read_mesh(path, unit_m), obj_id, name, n_points, seed, symmetries, diameter_m)


def model_of_mesh(
    mesh: Mesh,
    obj_id: int,
    name: str,
    n_points: int,
    seed: int,
    symmetries: Float | None = None,
    diameter_m: float | None = None,
) -> ObjectModel:
    """The model of a mesh that is already in memory; arguments as :func:`load_model`.

    Raises:
        InputError: the mesh has no surface.
    """
    triangles = mesh.vertices_m[mesh.faces]
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    double_area = np.linalg.norm(cross, axis=1)
    if not double_area.sum() > 0:
        raise InputError(f"the mesh of object {obj_id} ({name}) has no surface: all its triangles are degenerate")
    shape = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)
    points, face_of_point = trimesh.sample.sample_surface(shape, n_points, face_weight=double_area, seed=seed)[:2]
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
    )


class ModelLibrary:
    """The models of one data set; each is read when it is first asked for, and kept.

    Args:
        dataset: the data set's folder; models are in ``models``, else ``models_eval``, else any ``models_*``.
        n_points: points to sample on each model.
        seed: of the sampling.

    Raises:
        InputError: no folder of models, or its JSON files are damaged.
    """

    def __init__(self, dataset: Path, n_points: int, seed: int) -> None:
        self.folder = _models_folder(dataset)
        self._n_points = n_points
        self._seed = seed
        self._info: dict[str, Any] = {}
        if (self.folder / "models_info.json").is_file():
            self._info = read_json(self.folder / "models_info.json", dict)
        self._names = _names(dataset, self.folder)
        self._loaded: dict[int, tuple[ObjectModel, tuple[str, ...]]] = {}
        found = {p.stem for p in self.folder.iterdir() if p.suffix.lower() in FORMATS}
        self.ids: tuple[int, ...] = tuple(
            sorted(int(s.removeprefix("obj_")) for s in found if s.startswith("obj_") and s[4:].isdecimal())
        )
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
        """What a person should know about the model: units guessed, texture missing, …"""
        return self._load(obj_id)[1]

    def _load(self, obj_id: int) -> tuple[ObjectModel, tuple[str, ...]]:
        if obj_id not in self._loaded:
            self._loaded[obj_id] = self._read(obj_id)
        return self._loaded[obj_id]

    def _read(self, obj_id: int) -> tuple[ObjectModel, tuple[str, ...]]:
        path = next((p for f in FORMATS if (p := self.folder / f"obj_{obj_id:06d}{f}").is_file()), None)
        if path is None:
            raise InputError(f"{unknown('model', obj_id, self.ids)} in {self.folder}")
        where = f"{self.folder / 'models_info.json'}, object {obj_id}"
        info = self._info.get(str(obj_id), {})
        if not isinstance(info, dict):
            raise InputError(f"{where} is a JSON {type(info).__name__}, expected an object with 'diameter'")
        stated_m = number_of(info, "diameter", where) * 1e-3 if "diameter" in info else None
        if stated_m is not None and stated_m <= 0:
            raise InputError(f"{where}: 'diameter' is {stated_m * 1e3:g}, expected millimetres > 0")
        symmetries = symmetry_transforms(info, where)
        mesh = read_mesh(path, unit_of_format(path))
        factor, note = checked_unit(path.name, mesh.diameter_m, stated_m)
        if factor != 1.0:
            mesh = replace(mesh, vertices_m=mesh.vertices_m * factor)
        model = model_of_mesh(mesh, obj_id, self.name(obj_id), self._n_points, self._seed, symmetries, stated_m)
        notes = mesh.notes + ((note,) if note else ())
        return model, tuple(f"{self.name(obj_id)} ({obj_id}): {note}" for note in notes)


def _models_folder(dataset: Path) -> Path:
    names = ["models", "models_eval", *sorted(p.name for p in dataset.glob("models_*") if p.is_dir())]
    for name in names:
        if any((dataset / name).glob("obj_*")):
            return dataset / name
    raise InputError(f"{dataset} has no object models; expected models/obj_000001.ply, … (or models_eval/)")


def _names(dataset: Path, models: Path) -> dict[int, str]:
    path = next((f / "obj_names.json" for f in (models, dataset) if (f / "obj_names.json").is_file()), None)
    if path is None:
        return {}
    names: dict[int, str] = {}
    for key, value in read_json(path, dict).items():
        # Both directions are in use: {"1": "can"} and {"can": 1}.
        pair = (key, value) if str(key).isdecimal() else (value, key)
        if not str(pair[0]).isdecimal():
            raise InputError(f"{path}: {key!r}: {value!r} does not name an object id")
        names[int(pair[0])] = str(pair[1])
    return names
