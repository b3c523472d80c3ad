"""An object model as pose errors need it: every vertex of its file, in millimetres."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.files import Numbered
from verefine_viz.core.model import ObjectModel
from verefine_viz.refiners.nearest import NearestIndex
from verefine_viz.rendering.mesh import RenderMesh, render_mesh
from verefine_viz.scenes.meshes import hull_vertices, largest_distance, mesh_files, read_geometry, unit_of_format
from verefine_viz.scenes.models import ModelInfo, checked_unit, combined_symmetries, listed_symmetries, models_beside

STEP = 0.01
"""Largest way of a point between two steps of a continuous symmetry, as a share of the diameter (BOP)."""


def bop_symmetries(info: ModelInfo, where: str, step: float = STEP) -> Float:
    """All transforms (S, 4, 4) [mm] of the object frame that leave the object looking the same; the identity first.

    As the official scores take them, and unlike those of refiners: discrete ones keep the rounded digits of the file,
    and a continuous one has ceil(π / step) steps, which are 315.

    Args:
        info: the object's entry of models_info.json (millimetres).
        where: what to call the entry in an error.
        step: see :data:`STEP`.

    Raises:
        InputError: an entry is incomplete.
    """
    return combined_symmetries(*listed_symmetries(info, where, int(np.ceil(np.pi / step)), 1.0))


N_PROBES = 24
"""Vertices, far from each other, that bound the largest distance from below."""


@dataclass(frozen=True, eq=False)
class EvalModel:
    """What pose errors are measured on."""

    obj_id: int
    vertices_mm: Float
    """(V, 3) in the file's order."""
    faces: NDArray[np.int32]
    """(F, 3)."""
    diameter_mm: float
    symmetries_mm: Float
    """(S, 4, 4) [mm], the identity first."""

    @property
    def is_symmetric(self) -> bool:
        """Whether another pose of it looks the same."""
        return len(self.symmetries_mm) > 1

    @cached_property
    def mesh(self) -> RenderMesh:
        """What is drawn [m]."""
        return render_mesh(self.vertices_mm * 1e-3, self.faces)

    @cached_property
    def sorted_vertices(self) -> tuple[Float, int]:
        """The vertices (V, 3) [mm], extreme ones first, and how many of them hold those that span the convex hull.

        A search for the largest distance that stops early should meet large ones soon.
        """
        points = np.unique(self.vertices_mm, axis=0)
        hull = hull_vertices(points)
        probes = hull[_far_apart(points[hull], N_PROBES)]
        rest = np.setdiff1d(hull, probes)
        inside = np.setdiff1d(np.arange(len(points)), hull)
        return np.ascontiguousarray(points[np.concatenate([probes, rest, inside])]), len(hull)

    @cached_property
    def nearest(self) -> NearestIndex:
        """Finds nearest vertices [m]; takes some 0.3 s to build."""
        return NearestIndex.build(self.vertices_mm * 1e-3)

    @cached_property
    def corners_mm(self) -> Float:
        """(8, 3) of the box that holds all vertices [mm]."""
        low, high = self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)
        return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def eval_model(model: ObjectModel) -> EvalModel:
    """The evaluation model of one that is already in memory, with its own vertices and symmetries."""
    symmetries_mm = np.array(model.symmetries)
    symmetries_mm[:, :3, 3] *= 1e3
    return EvalModel(model.obj_id, model.vertices * 1e3, model.faces, model.diameter_m * 1e3, symmetries_mm)


class EvalModels:
    """The models of a data set that scores are measured on: ``models_eval``, else ``models``.

    Args:
        dataset: the data set's folder.

    Raises:
        InputError: neither folder is there, or models_info.json is missing or damaged.
    """

    def __init__(self, dataset: Path) -> None:
        folders = [dataset / name for name in ("models_eval", "models") if any((dataset / name).glob("obj_*"))]
        if not folders:
            expected = "models_eval/obj_000001.ply, … (or models/)"
            raise InputError(f"{dataset} has no object models; expected {expected}{models_beside(dataset)}")
        self.folder = folders[0]
        self._infos = Numbered(self.folder / "models_info.json", ModelInfo, "object")
        self._meshes = mesh_files(self.folder)
        self._loaded: dict[int, EvalModel] = {}
        self._unit_notes: list[str] = []

    @property
    def notes(self) -> tuple[str, ...]:
        """Where the models come from, if not from the official folder, and which of those read so far are not as large
        as is stated.
        """
        where = f"there is no models_eval; errors are measured on {self.folder.name}, which differs a little"
        return (*([] if self.folder.name == "models_eval" else [where]), *self._unit_notes)

    def get(self, obj_id: int) -> EvalModel:
        """The model of an object, read when it is first asked for.

        Raises:
            InputError: there is none, its mesh is damaged, or models_info.json lacks its diameter.
        """
        if obj_id not in self._loaded:
            self._loaded[obj_id] = self._read(obj_id)
        return self._loaded[obj_id]

    def diameter_mm(self, obj_id: int) -> float:
        """An object's diameter by models_info.json [mm]; its mesh is not read.

        Raises:
            InputError: there is none.
        """
        diameter_mm = self._infos[obj_id].diameter if obj_id in self._infos else None
        if diameter_mm is None:
            raise InputError(f"{self._infos.where(obj_id)} has no 'diameter', which is needed")
        return diameter_mm

    def _read(self, obj_id: int) -> EvalModel:
        if obj_id not in self._meshes:
            raise InputError(f"{unknown('model', obj_id, self._meshes)} in {self.folder}")
        path = self._meshes[obj_id]
        diameter_mm = self.diameter_mm(obj_id)
        symmetries_mm = bop_symmetries(self._infos[obj_id], self._infos.where(obj_id))
        vertices, faces = read_geometry(path)
        if not np.ptp(vertices, axis=0).any():
            raise InputError(f"{path} has no extent: all its vertices are one point")
        in_mm = vertices if unit_of_format(path) == 1e-3 else vertices * 1e3
        # As where objects are solved: a mesh must not be measured in another unit.
        factor, note = checked_unit(path.name, largest_distance(in_mm) * 1e-3, diameter_mm * 1e-3)
        if note:
            self._unit_notes.append(f"object {obj_id}: {note}")
        return EvalModel(obj_id, in_mm if factor == 1.0 else in_mm * factor, faces, diameter_mm, symmetries_mm)


def _far_apart(points: Float, n: int) -> list[int]:
    """Indices of up to ``n`` points, each the farthest from those before it, the first from their middle."""
    chosen: list[int] = []
    distance = np.linalg.norm(points - points.mean(axis=0), axis=1)
    for _ in range(min(n, len(points))):
        chosen.append(int(np.argmax(distance)))
        here = np.linalg.norm(points - points[chosen[-1]], axis=1)
        distance = here if len(chosen) == 1 else np.minimum(distance, here)
        if distance.max() == 0:
            break
    return chosen
