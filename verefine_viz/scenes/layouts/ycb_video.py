"""YCB-Video in its own layout: ``data/0000/000001-color.png``, ``-depth.png``, ``-label.png``, ``-meta.mat``.

The MATLAB file holds intrinsics, the depth's factor and the poses of all objects in metres, which are of the original
models, ``models/002_master_chef_can/textured.obj``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.files import read_file
from verefine_viz.core.geometry import rounding_note
from verefine_viz.scenes.image_files import color_of, read_steps, size_text
from verefine_viz.scenes.mat_file import mat_arrays
from verefine_viz.scenes.recorded_frame import (
    RecordedFrame,
    RecordedObject,
    depth_in_steps,
    image_of,
    images_in,
    meshes_in,
    near_pose,
)

META, KEYFRAMES = "-meta.mat", Path("image_sets", "keyframe.txt")
CLASSES = (
    "002_master_chef_can",
    "003_cracker_box",
    "004_sugar_box",
    "005_tomato_soup_can",
    "006_mustard_bottle",
    "007_tuna_fish_can",
    "008_pudding_box",
    "009_gelatin_box",
    "010_potted_meat_can",
    "011_banana",
    "019_pitcher_base",
    "021_bleach_cleanser",
    "024_bowl",
    "025_mug",
    "035_power_drill",
    "036_wood_block",
    "037_scissors",
    "040_large_marker",
    "051_large_clamp",
    "052_extra_large_clamp",
    "061_foam_brick",
)
"""The objects in the order of their numbers, from 1."""


class Reader:
    """The frames of the data set, those of ``image_sets/keyframe.txt`` where that is there, or of one of its folders;
    see :class:`~verefine_viz.scenes.recorded_frame.LayoutReader`.
    """

    LAYOUT = "layout of YCB-Video"
    LOOKS_LIKE = "data/0000/000001-color.png, -depth.png, -label.png, -meta.mat, models/"
    NEEDS = ()
    is_sequence = has_truth = True
    has_poses = False

    def __init__(self, folder: Path) -> None:
        is_scene = _is_scene(folder)
        self._data = (folder.resolve().parent if is_scene else folder / "data").resolve()
        places = (self._data.parent, self._data, folder.resolve())
        self._models = next((place / "models" for place in places if (place / "models").is_dir()), places[0] / "models")
        scenes = [folder.resolve().name] if is_scene else sorted(p.name for p in self._data.iterdir() if _is_scene(p))
        listed = () if is_scene else tuple(_listed(self._data.parent / KEYFRAMES))
        there = tuple(name for name in listed if (self._data / f"{name}{META}").is_file())
        every = (f"{scene}/{name}" for scene in scenes for name in images_in(self._data / scene, f"*{META}"))
        self.names: tuple[str, ...] = there or tuple(every)
        self.objects: Mapping[str, int] = {name: k for k, name in enumerate(CLASSES, 1)}
        self.notes = () if self._models.is_dir() else (f"{self._models} is missing; expected {CLASSES[0]}/, …",)

    @staticmethod
    def recognizes(folder: Path) -> bool:
        data = folder / "data"
        return _is_scene(folder) or (data.is_dir() and any(map(_is_scene, data.iterdir())))

    def frame(self, name: str) -> RecordedFrame:
        """One frame with all its objects at ground truth."""
        path = self._data / f"{name}{META}"
        meta = mat_arrays(path, "cls_indexes", "factor_depth", "intrinsic_matrix", "poses")
        K, factor, indices, poses = (_array(meta, path, *one) for one in SHAPES)
        if len(indices) != poses.shape[2] or not 1 <= factor.item() <= 1e6:
            raise InputError(f"{path}: {len(indices)} objects, {poses.shape[2]} poses, factor {factor.item():g}")
        depth_m, notes = depth_in_steps(image_of(self._data, f"{name}-depth"), 1e3 / factor.item())
        labels = read_steps(image_of(self._data, f"{name}-label"), 1.0)
        if labels.shape != depth_m.shape:
            raise InputError(
                f"{name}-label.png is {size_text(labels.shape)} pixels, depth is {size_text(depth_m.shape)}"
            )
        rgb, of_color = color_of(self._data / f"{name}-color.png", depth_m.shape)
        notes += of_color
        taken: list[Float] = []
        objects: list[RecordedObject] = []
        for k, index in enumerate(indices.ravel().tolist()):
            if not 1 <= index <= len(CLASSES):
                notes.append(f"object {index:g} of {path.name} is none of YCB-Video; it is left out")
                continue
            called, T_gt = CLASSES[int(index) - 1], None
            try:
                T_gt = near_pose(poses[:, :, k])
                taken.append(poses[:, :3, k])
            except ShapeError as error:
                notes.append(f"{called} has no ground truth: {error}")
            objects.append(
                RecordedObject(called, model_of(self._models, called), 1.0, labels == index, T_cam_obj_gt=T_gt)
            )
        notes += rounding_note(f"ground truth of the frame's {META}", taken)
        return RecordedFrame(name, K, depth_m, rgb, tuple(objects), notes=tuple(notes))

    def answers(self, name: str) -> Mapping[str, tuple[Float | None, float | None]]:
        """None: the layout holds no program's poses."""
        return {}


SHAPES = (("intrinsic_matrix", (3, 3)), ("factor_depth", (1, 1)), ("cls_indexes", (-1, 1)), ("poses", (3, 4, -1)))


def _array(meta: Mapping[str, NDArray[np.float64]], path: Path, name: str, shape: tuple[int, ...]) -> Float:
    try:
        array = meta[name] if meta[name].ndim == len(shape) else meta[name][..., None]  # One object's poses are 3×4.
        return array.reshape(shape) if -1 not in shape[:1] else array.reshape(-1, 1)
    except (KeyError, ValueError):
        raise InputError(f"{path} has no {name!r} of shape {shape}") from None


def model_of(models: Path, called: str) -> Path:
    """The mesh of an object, ``textured.obj`` before others; where there is none, where it should be."""
    files = sorted(meshes_in(models / called), key=lambda path: (not path.stem.startswith("textured"), path.name))
    return files[0] if files else models / called / "textured.obj"


def _is_scene(folder: Path) -> bool:
    return any(folder.glob(f"*{META}"))


def _listed(path: Path) -> Iterator[str]:
    yield from read_file(path).decode("utf-8", "replace").split() if path.is_file() else ()
