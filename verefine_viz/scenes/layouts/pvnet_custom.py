"""A custom set of PVNet: ``rgb/0.jpg`` or ``JPEGImages/000000.jpg``, ``mask/0.png``, ``pose/pose0.npy``,
``camera.txt``, ``model.ply``.

Poses are ground truth, 3×4 in metres; ``diameter.txt``, which may be there, is in metres, too. PVNet needs no depth, so
that it is put beside: ``depth/0.png`` in millimetres (or ``0.npy``, also in metres).

Source: github.com/zju3dv/clean-pvnet, "Training on the custom object".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError, one_line
from verefine_viz.core.files import id_of
from verefine_viz.scenes.image_files import SUFFIXES, color_of, read_mask
from verefine_viz.scenes.meshes import read_geometry
from verefine_viz.scenes.recorded_frame import (
    LABEL,
    RecordedFrame,
    RecordedObject,
    depth_of,
    image_of,
    matrix_in,
    natural_key,
    numbers_in,
    pose_in,
    unit_of,
)

CAMERA, POSES, DEPTH, MODEL, DIAMETER = "camera.txt", "pose", "depth", "model.ply", "diameter.txt"
PHOTOS = ("rgb", "JPEGImages")
"""Folders of colour images; those of the second, as its LINEMOD has it, are numbered with other zeros than depth."""
UNITS_M = (1.0, 0.01, 0.001)
MOST_OFF = 2.0
"""Size of a mesh over the diameter that is stated: of a right one it is 1 (a rod) to √3 (a ball), as its box counts."""


class Reader:
    """The frames of such a folder, with one object; see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`."""

    LAYOUT = "layout of PVNet's custom sets"
    LOOKS_LIKE = "camera.txt, pose/pose0.npy, rgb/, mask/, depth/, model.ply"
    NEEDS = (
        (CAMERA, "the 3×3 camera matrix [px]"),
        (POSES, "pose0.npy, …, 3×4 [m]"),
        (MODEL, "the mesh"),
    )
    is_sequence = has_poses = False
    has_truth = True
    notes = ()

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        depth = folder / DEPTH
        stems = {path.stem for path in depth.glob("*.*") if path.suffix.lower() in SUFFIXES}
        if not stems:
            raise InputError(
                f"{folder} is in the {self.LAYOUT}, which have no depth, and poses are verified by depth; put a depth "
                f"image [mm] of each frame into {DEPTH}/, named as in rgb/"
            )
        self.names: tuple[str, ...] = tuple(sorted(stems, key=natural_key))
        self.objects: Mapping[str, int] = {one_line(folder.resolve().name): 1}
        folders = (folder / place for place in PHOTOS)
        photos = next((place for place in folders if place.is_dir()), folder / PHOTOS[0])
        files = (path for path in photos.glob("*.*") if path.suffix.lower() in SUFFIXES)
        self._photos = {_numbered(path.stem): path for path in files}
        named = ((re.fullmatch(r"(?:pose)?(\d{1,18})\.npy", path.name), path) for path in (folder / POSES).iterdir())
        self._poses: dict[int | None, Path] = {int(match[1]): path for match, path in named if match}

    @staticmethod
    def recognizes(folder: Path) -> bool:
        return (folder / CAMERA).is_file() and (folder / POSES).is_dir()

    def frame(self, name: str) -> RecordedFrame:
        """One frame at its ground truth."""
        depth_m, notes = depth_of(image_of(self._folder / DEPTH, name))
        rgb, of_color = color_of(self._photos.get(_numbered(name)), depth_m.shape)
        mask = read_mask(image_of(self._folder / "mask", name), depth_m.shape, self._folder / "mask" / LABEL)
        T_gt, (unit_m, of_unit) = None, self._unit
        path = self._poses.get(id_of(name))
        try:
            T_gt = None if path is None else pose_in(path)
            notes += [f"{POSES}/ has no pose of this frame"] * (path is None)
        except (InputError, ShapeError) as error:
            notes.append(f"the pose of this frame is left out: {error}")
        (called,) = self.objects
        one = RecordedObject(called, self._folder / MODEL, unit_m, mask, T_cam_obj_gt=T_gt)
        K = matrix_in(self._folder / CAMERA)
        return RecordedFrame(name, K, depth_m, rgb, (one,), notes=(*notes, *of_color, *of_unit))

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """None: the layout holds no program's poses."""
        return {}

    @cached_property
    def _unit(self) -> tuple[float, tuple[str, ...]]:
        """Metres per unit of the mesh: what makes it as large as the diameter that is stated, else by its size."""
        mesh, path = self._folder / MODEL, self._folder / DIAMETER
        if not path.is_file():
            return unit_of(mesh), ()
        size = float(np.linalg.norm(np.ptp(read_geometry(mesh)[0], axis=0)))
        try:
            diameter_m = float(numbers_in(path).max(initial=0))
        except InputError as error:
            return unit_of(mesh), (f"{error}; the size of {mesh.name} decides its unit",)
        if not (diameter_m > 0 and size > 0):
            return unit_of(mesh), (f"{DIAMETER} holds {diameter_m:g}; the size of {mesh.name} decides its unit",)
        unit_m = min(UNITS_M, key=lambda unit: abs(np.log(size * unit / diameter_m)))
        if max(size * unit_m / diameter_m, diameter_m / (size * unit_m)) <= MOST_OFF:
            return unit_m, ()
        return unit_m, (f"{mesh.name} is {size * unit_m:.3g} m across, {DIAMETER} says {diameter_m:.3g} m",)


def _numbered(stem: str) -> int | str:
    """The number that a name is, else the name."""
    number = id_of(stem)
    return stem if number is None else number
