"""A folder of images in order with a pose per frame, as FoundationPose's demo and YCBInEOAT have them.

``rgb/`` and ``depth/`` (images of the same names), ``cam_K.txt``, ``mesh/*.obj``, and where they are there ``masks/``
(often of the first frame only), ``ob_in_cam/*.txt`` (the program's poses, 4×4 in metres) and ``annotated_poses/*.txt``
(ground truth).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError, in_one_line
from verefine_viz.core.files import reading
from verefine_viz.core.geometry import FARTHEST_M, as_rigid, distance_m
from verefine_viz.core.problem import ANSWER, Hypothesis, RecordedStep
from verefine_viz.scenes.image_files import SUFFIXES, find_image, read_color, read_mask, read_steps, size_text
from verefine_viz.scenes.meshes import FORMATS, read_geometry
from verefine_viz.scenes.trace_files import RecordedFrame, RecordedObject

CAMERA, DEPTH, RGB = "cam_K.txt", "depth", "rgb"
MASKS, MESHES = ("masks", "mask", "gt_mask"), ("mesh", "meshes", "model", "models")
POSES, GROUND_TRUTH = "ob_in_cam", "annotated_poses"
MOST_BYTES = 1_000_000
"""Of a text file of a matrix."""
LARGEST_M, DEEPEST_M = 5.0, 60.0
"""A mesh that is larger, and depth with a median beyond, are in millimetres."""


def is_sequence(folder: Path) -> bool:
    """Whether a folder looks like one."""
    return (folder / CAMERA).is_file() and (folder / DEPTH).is_dir()


@dataclass(frozen=True)
class PoseSequence:
    """The frames of such a folder, with one object.

    Raises:
        InputError: an image, the camera or the mesh is missing or damaged, when it is first asked for.
    """

    folder: Path
    notes: tuple[str, ...] = ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the frames, those of their depth images, in order."""
        if not is_sequence(self.folder):
            raise InputError(
                f"{self.folder} holds no sequence; expected {CAMERA}, {DEPTH}/, {RGB}/ and mesh/*.obj in it"
            )
        stems = {path.stem for path in (self.folder / DEPTH).iterdir() if path.suffix.lower() in SUFFIXES}
        names = sorted(stems, key=_in_order)
        if not names:
            raise InputError(f"{self.folder / DEPTH} holds no image; expected {', '.join(SUFFIXES)}")
        return tuple(names)

    @property
    def objects(self) -> tuple[str, ...]:
        """The one object, which is called as the folder is."""
        return (in_one_line(self.folder.resolve().name),)

    def frame(self, name: str) -> RecordedFrame:
        """One frame; a pose that cannot be read becomes a note."""
        path = self._image(DEPTH, name)
        depth, notes = _depth(path)
        color = find_image(self.folder / RGB, name)
        rgb = None if color is None else read_color(color)
        if rgb is not None and rgb.shape[:2] != depth.shape:
            raise InputError(
                f"{color} is {size_text(rgb.shape)} pixels, {path} is {size_text(depth.shape)}; expected one size"
            )
        if rgb is None:
            notes.append(f"{RGB}/ has no image {name}")
        if len(self._mesh_files) > 1:
            first, second, *_ = self._mesh_files
            notes.append(f"the folder holds {len(self._mesh_files)} meshes; {first.name} is used, not {second.name}")
        mask_file = next((file for kind in MASKS if (file := find_image(self.folder / kind, name))), None)
        pose, T_gt = (self._pose(kind, name, notes) for kind in (self._poses, GROUND_TRUTH))
        poses = () if pose is None else (Hypothesis(pose, 1.0, POSES),)
        one = RecordedObject(
            self.objects[0],
            self._mesh[0],
            self._mesh[1],
            None if mask_file is None else read_mask(mask_file, depth.shape),
            poses,
            (None,) * len(poses),
            () if pose is None else (RecordedStep(0, pose, ANSWER),),
            T_gt,
        )
        return RecordedFrame(name, self._K, depth, rgb, (one,), notes=tuple(notes))

    def answers(self, name: str) -> dict[str, tuple[Float | None, float | None]]:
        """The program's pose (4, 4) [m] of a frame, None where it has none that can be read; it has no score."""
        return {self.objects[0]: (self._pose(self._poses, name, []), None)}

    def _image(self, kind: str, name: str) -> Path:
        path = find_image(self.folder / kind, name)
        if path is None:
            raise InputError(f"{self.folder / kind} has no image {name}")
        return path

    def _pose(self, kind: str, name: str, notes: list[str]) -> Float | None:
        path = self.folder / kind / f"{name}.txt"
        if not path.is_file():
            if (self.folder / kind).is_dir():
                notes.append(f"{kind}/ has no pose of this frame")
            return None
        try:
            T = as_rigid(_matrix(path, (4, 4)), "the pose")
            if distance_m(T) > FARTHEST_M:
                raise ShapeError(f"the pose is {distance_m(T):.3g} m away, expected metres")
            return T
        except (InputError, ShapeError) as error:
            notes.append(f"{kind}/{path.name} is left out: {error}")
            return None

    @cached_property
    def _poses(self) -> str:
        """The folder of the program's poses, which FoundationPose writes into its debug folder."""
        return next((kind for kind in (POSES, f"debug/{POSES}") if (self.folder / kind).is_dir()), POSES)

    @cached_property
    def _K(self) -> Float:
        return _matrix(self.folder / CAMERA, (3, 3))

    @cached_property
    def _mesh_files(self) -> tuple[Path, ...]:
        places = [self.folder / name for name in MESHES] + [self.folder]
        files = [file for place in places for file in sorted(place.glob("*.*")) if file.suffix.lower() in FORMATS]
        if not files:
            raise InputError(f"{self.folder} has no mesh; expected mesh/*.obj (or .ply, .glb, .stl)")
        return tuple(files)

    @cached_property
    def _mesh(self) -> tuple[Path, float]:
        """The mesh file and its unit [m]."""
        file = self._mesh_files[0]
        size = float(np.linalg.norm(np.ptp(read_geometry(file)[0], axis=0)))
        return file, 1e-3 if size > LARGEST_M else 1.0


def _in_order(name: str) -> tuple[int, str]:
    """Names that are numbers go by these, whatever zeros are in front: 8, 9, 10."""
    return (int(name), name) if name.isdecimal() and len(name) < 100 else (0, name)


def _depth(path: Path) -> tuple[NDArray[np.float32], list[str]]:
    """Depth (H, W) [m] of an image in millimetres, or in metres, which is noted."""
    values = read_steps(path, 1.0)
    measured = values[values > 0]
    if len(measured) and float(np.median(measured)) <= DEEPEST_M:
        return values.astype(np.float32), [f"{path.name} has a median of {np.median(measured):.3g}: depth in metres"]
    return (values * 1e-3).astype(np.float32), []


def _matrix(path: Path, shape: tuple[int, int]) -> Float:
    """The numbers of a text file.

    Raises:
        InputError: there are others than expected.
    """
    with reading(path, most_bytes=MOST_BYTES) as file:
        values = np.array(file.read().decode("utf-8-sig").replace(",", " ").split(), dtype=np.float64)
        if values.size != shape[0] * shape[1] or not np.isfinite(values).all():
            raise ValueError(f"{values.size} numbers, expected {shape[0]}×{shape[1]} finite ones")
        return values.reshape(shape)
