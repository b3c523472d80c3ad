"""Frames that another program read or wrote, and the functions that readers of such recordings share."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verefine_viz.core.array_cache import NPZ_READING
from verefine_viz.core.arrays import Float, Mask, plain_array
from verefine_viz.core.errors import ContentError, InputError, ShapeError
from verefine_viz.core.files import reading
from verefine_viz.core.geometry import FARTHEST_M, as_rigid, distance_m, rotation_of_quat_wxyz, transform
from verefine_viz.core.problem import Hypothesis, RecordedStep
from verefine_viz.scenes.image_files import find_image, read_steps
from verefine_viz.scenes.meshes import FORMATS, Mesh, read_geometry

LABEL = "label.txt"
"""File beside masks with the pixel value of the object, where masks hold several objects."""
MOST_BYTES = 1_000_000
"""Largest size of a file with a matrix."""
LARGEST_M, FARTHEST_MEDIAN_M = 5.0, 60.0
"""A larger mesh, or depth with a larger median, is in millimetres."""


@dataclass(frozen=True, eq=False)
class RecordedObject:
    """An object of a frame, and what another program did to its poses."""

    name: str
    mesh: Path | Mesh | None
    """A mesh file, or a mesh in memory; None where there is none."""
    unit_m: float
    """Metres per unit of the mesh file."""
    mask: Mask | None
    """(H, W); None = the pixels that its first pose covers."""
    hypotheses: tuple[Hypothesis, ...] = ()
    scores: tuple[float | None, ...] = ()
    """The program's own scores of the hypotheses."""
    steps: tuple[RecordedStep, ...] = ()
    T_cam_obj_gt: Float | None = None
    symmetry_axis: Float | None = None
    """(3,) through the middle of the mesh's box, of any length: every turn about it looks the same."""


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """A frame as another program had it."""

    name: str
    K: Float
    depth_m: NDArray[np.float32]
    """(H, W) [m], 0 where nothing was measured."""
    rgb: NDArray[np.uint8] | None
    objects: tuple[RecordedObject, ...]
    down_cam: Float | None = None
    """(3,) direction in which things fall, of any length."""
    notes: tuple[str, ...] = ()
    order: tuple[tuple[int, ...], ...] = ()
    """Clusters in solving order, as indices into ``objects``; empty where the recording gives none."""


class Recording(Protocol):
    """Frames of another program; files are read when needed."""

    @property
    def names(self) -> tuple[str, ...]:
        """The frames in order, "scene/image" where the layout has scenes."""
        ...

    @property
    def objects(self) -> Mapping[str, int]:
        """The number of each object, by name."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about all frames."""
        ...

    @property
    def is_sequence(self) -> bool:
        """Whether the frames are in order, as in a video."""
        ...

    @property
    def has_poses(self) -> bool:
        """Whether it holds poses by the program that made it."""
        ...

    @property
    def has_truth(self) -> bool:
        """Whether it holds ground truth."""
        ...

    def frame(self, name: str) -> RecordedFrame:
        """One of the frames.

        Raises:
            InputError: a file that it needs is missing or damaged.
        """
        ...

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """The program's pose (4, 4) [m] of each object of a frame and its score, None where it has none."""
        ...


class LayoutReader(Recording, Protocol):
    """Opens folders of one layout."""

    LAYOUT: ClassVar[str]
    """The program of the layout, as shown to the user."""
    LOOKS_LIKE: ClassVar[str]
    """The names by which it is recognized."""
    NEEDS: ClassVar[tuple[tuple[str, str], ...]]
    """Files and folders that such a folder always has, each with its meaning; none where names are not fixed."""

    def __init__(self, folder: Path) -> None:
        """Open a folder.

        Raises:
            InputError: a file that all frames share is missing or damaged.
        """

    @staticmethod
    def recognizes(folder: Path) -> bool:
        """Whether a folder has this layout."""
        ...


def frame_ids(names: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """(scene, image) of frames with such names, else scene 0 and a number: the one at the end of each name where these
    are unique, else 1, 2, …
    """
    of_scenes = [re.fullmatch(r"(\d{1,6})/(\d{1,9})", name) for name in names]
    if all(of_scenes):
        return tuple((int(match[1]), int(match[2])) for match in of_scenes if match is not None)
    ends = [re.search(r"(\d{1,6})$", name) for name in names]
    numbers = [int(end[1]) for end in ends if end is not None]
    is_clear = len({*numbers}) == len(names) and not any(re.search(r"\d{7}$", name) for name in names)
    return tuple((0, number) for number in (numbers if is_clear else range(1, len(names) + 1)))


# Functions that readers share.


def natural_key(name: str) -> tuple[tuple[int, str], ...]:
    """A key that sorts the numbers in names as numbers: 8, 9, 10."""
    parts = re.split(r"(\d{1,18})", name)
    return tuple((int(part), "") if part.isdecimal() else (-1, part) for part in parts)


def images_in(folder: Path, pattern: str = "*") -> dict[str, Path]:
    """The files of a folder that match a pattern such as ``*-color.png``, by the text in place of the star, in
    order.
    """
    before, after = pattern.split("*")
    names = {path.name[len(before) : len(path.name) - len(after)]: path for path in folder.glob(pattern)}
    return {name: names[name] for name in sorted(names, key=natural_key)}


def image_of(folder: Path, stem: str) -> Path:
    """The image of that name; InputError where there is none."""
    path = find_image(folder, stem)
    if path is None:
        raise InputError(f"{folder / f'{stem}.png'} is missing")
    return path


def depth_of(path: Path) -> tuple[NDArray[np.float32], list[str]]:
    """Depth (H, W) [m] of an image or array in millimetres; or in metres where its median says so, with a note."""
    values = read_steps(path, 1.0)
    measured = values[values > 0]
    if len(measured) and float(np.median(measured)) <= FARTHEST_MEDIAN_M:
        return values.astype(np.float32), [f"{path.name} has a median of {np.median(measured):.3g}: depth in metres"]
    return (values * 1e-3).astype(np.float32), []


def depth_in_steps(path: Path, scale_mm: float) -> tuple[NDArray[np.float32], list[str]]:
    """Depth (H, W) [m] of an image or an array in steps of ``scale_mm``; an array of floats is in mm or m, as
    :func:`depth_of` has it.
    """
    values = read_steps(path, scale_mm)
    if path.suffix == ".npy" and (values % 1).any():
        return depth_of(path)
    return (values * (scale_mm * 1e-3)).astype(np.float32), []


def unit_of(mesh: Path) -> float:
    """Metres per unit of a mesh file, by its size: 1 or 0.001."""
    size = float(np.linalg.norm(np.ptp(read_geometry(mesh)[0], axis=0)))
    return 1e-3 if size > LARGEST_M else 1.0


def meshes_in(folder: Path) -> tuple[Path, ...]:
    """The mesh files of a folder by name; none where it does not exist."""
    return tuple(file for file in sorted(folder.glob("*.*")) if file.suffix.lower() in FORMATS)


def numbers_in(path: Path) -> Float:
    """The numbers of a text file, or of an array (.npy), with its shape.

    Raises:
        InputError: the file holds something else, or they are not finite.
    """
    with reading(path, most_bytes=MOST_BYTES) as file:
        if path.suffix == ".npy":
            with NPZ_READING:
                values = plain_array(np.load(file, allow_pickle=False), np.float64)
        else:
            values = _numbers_of(file.read().decode("utf-8-sig"))
        if not np.isfinite(values).all():
            raise ContentError("it holds NaN or infinity, expected finite numbers")
        return values


def _numbers_of(text: str) -> Float:
    words = text.replace(",", " ").split()
    try:
        return np.array(words, dtype=np.float64)
    except ValueError:
        raise ContentError("it holds words, expected numbers alone") from None


def matrix_in(path: Path) -> Float:
    """The matrix (3, 3) of a text file or an array; InputError where it does not hold nine numbers."""
    values = numbers_in(path)
    if values.size != 9:
        raise InputError(f"{path}: {values.size} numbers, expected 3×3")
    return values.reshape(3, 3)


def pose_in(path: Path) -> Float:
    """The pose (4, 4) [m] of a text file or an array, 4×4 or 3×4.

    Raises:
        InputError: it is none.
        ShapeError: it is not a rigid transform, or not in metres.
    """
    values = numbers_in(path)
    if values.size not in (12, 16):
        raise InputError(f"{path}: {values.size} numbers, expected 4×4 or 3×4")
    return near_pose(values.reshape(-1, 4))


def near_pose(T: Float) -> Float:
    """A pose (4, 4) [m] of a matrix (3, 4) or (4, 4); ShapeError where it is no rigid transform, or not in metres."""
    T = as_rigid(np.vstack([T[:3], T[3] if len(T) == 4 else (0, 0, 0, 1)]), "the pose")
    if distance_m(T) > FARTHEST_M:
        raise ShapeError(f"the pose is {distance_m(T):.3g} m away, expected metres")
    return T


def pose_of_quat(quat_wxyz: ArrayLike, t_m: ArrayLike) -> Float:
    """A pose (4, 4) [m] of a quaternion (w, x, y, z) and a position; ShapeError as :func:`near_pose`."""
    if not np.linalg.norm(quat_wxyz) > 1e-6:
        raise ShapeError("the pose has a quaternion of zeros")
    return near_pose(transform(rotation_of_quat_wxyz(quat_wxyz), np.asarray(t_m, np.float64)))
