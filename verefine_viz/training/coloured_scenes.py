"""Pictures of coloured objects with their poses: made up, or the annotated frames of a BOP folder.

What DenseFusion is trained on. Same seed and number, same picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.demo import demo_names, demo_objects
from verefine_viz.scenes.demo_layout import Viewpoint, take_picture
from verefine_viz.scenes.demo_models import demo_model
from verefine_viz.scenes.models import ModelLibrary
from verefine_viz.scenes.sensor import Sensor, sense
from verefine_viz.scenes.source import open_scene

IMAGE_PX = (640, 480)
FOCAL_PX = (480.0, 700.0)
DISTANCE_M = (0.42, 0.95)
"""Distance of the camera from the middle of the table."""
ELEVATION_DEG = (25.0, 65.0)
OBJECTS = (2, 6)
"""Fewest and most objects of a picture, the last excluded."""
SPREAD_M = 0.18
"""Objects stand within this of the middle of the table."""
STANDS = 0.8
"""How often an object stands as its model does; else it is turned at random."""
LEAST_PX = 150
"""Pixels of an object that show; with fewer it is not learned from."""
MODEL_POINTS = 500
"""Points of each model that measure how far apart two poses are."""


@dataclass(frozen=True, eq=False)
class LabelledObject:
    """One object in one picture, with its pose."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth_m: NDArray[np.float32]
    """(H, W) z [m], 0 = not measured."""
    mask: Mask
    """(H, W) what a detector takes for it."""
    camera: Camera
    model: ObjectModel
    T_cam_obj: Float
    """(4, 4) ground truth [m]."""


class ColouredScenes(Protocol):
    """Endless pictures."""

    models: tuple[ObjectModel, ...]
    """Models of the objects in them."""
    described: str
    """What they are, for the model card."""

    def picture(self, index: int) -> tuple[LabelledObject, ...]:
        """The objects of a picture."""
        ...


class MadeUpScenes:
    """Objects at random on a table under a lamp, seen from anywhere above.

    Args:
        models: with colours of their own.
        seed: of all pictures.
        described: what the models are.
        is_halved: whether pictures are drawn at half their size and enlarged, in a quarter of the time: for a network
            that sees its crops at half their size.
    """

    def __init__(self, models: Sequence[ObjectModel], seed: int, described: str, is_halved: bool) -> None:
        self.models, self._seed, self._is_halved = tuple(models), seed, is_halved
        self.described = f"made-up views of {described}"

    def picture(self, index: int) -> tuple[LabelledObject, ...]:
        """See :class:`ColouredScenes`."""
        rng = np.random.default_rng((self._seed, index))
        T_world_cam, camera = _viewpoint(rng)
        placed = self._placed(rng, inverse(T_world_cam))
        step = 2 if self._is_halved else 1
        drawn = every_pixel(camera, step)
        seen = take_picture(placed, T_world_cam, drawn)
        # Noise in pixels of the whole picture.
        sensor = Sensor(noise_px=rng.uniform(0.02, 0.1) / step, edge_dropout=rng.uniform(0.2, 0.8))
        sensed_m = sense(seen.depth_m, seen.normals_cam, drawn, int(rng.integers(2**31)), sensor)
        rgb = enlarged(_tinted(seen.rgb, seen.labels, rng), step)
        depth_m, labels = enlarged(sensed_m, step), enlarged(seen.labels, step)
        objects = []
        for k, item in enumerate(placed):
            visible = labels == k
            if (visible & (depth_m > 0)).sum() >= LEAST_PX:
                mask = _detected(visible, rng)
                objects.append(LabelledObject(rgb, depth_m, mask, camera, item.model, item.T_cam_obj))
        return tuple(objects)

    def _placed(self, rng: np.random.Generator, T_cam_world: Float) -> list[Placed]:
        """Objects that stand or lie on the table beside each other."""
        n = min(int(rng.integers(*OBJECTS)), len(self.models))
        placed: list[Placed] = []
        taken: list[tuple[Float, float]] = []
        for k in rng.choice(len(self.models), n, replace=False):
            model = self.models[k]
            R = axis_angle([0, 0, 1], rng.uniform(0, 2 * np.pi))
            if rng.random() >= STANDS:
                R = R @ axis_angle(random_unit_vector(rng), rng.uniform(0, np.pi))
            turned = model.vertices @ R.T
            reach_m = float(np.linalg.norm(turned[:, :2], axis=1).max())
            for _ in range(20):
                place = rng.uniform(-SPREAD_M, SPREAD_M, 2)
                if all(np.linalg.norm(place - other) > 0.7 * (reach_m + reach) for other, reach in taken):
                    taken.append((place, reach_m))
                    T_world_obj = transform(R, [*place, -turned[:, 2].min()])
                    placed.append(Placed(len(placed), model, T_cam_world @ T_world_obj))
                    break
        return placed


class AnnotatedFrames:
    """The frames of a split of a BOP folder that have ground truth, in random order.

    Args:
        dataset: the folder.
        split: the folder of the split below it.
        seed: of the order.

    Raises:
        VerefineError: the folder is none of a BOP data set, or has no such split.
    """

    def __init__(self, dataset: Path, split: str, seed: int) -> None:
        scene = SceneSettings(source="bop", dataset=str(dataset), split=split, model_points=MODEL_POINTS)
        self._source = open_scene(scene, HypothesesSettings())
        self._seed = seed
        library = ModelLibrary(dataset, MODEL_POINTS, 0)
        self.models = tuple(library.get(obj_id) for obj_id in library.ids)
        self.described = f"{len(self._source.frames)} annotated frames of {dataset.resolve().name}/{split}"

    def picture(self, index: int) -> tuple[LabelledObject, ...]:
        """See :class:`ColouredScenes`."""
        rng = np.random.default_rng((self._seed, index))
        rgb, objects = self._frame(self._source.frames[int(rng.integers(len(self._source.frames)))])
        tinted = _tinted(rgb, np.full(rgb.shape[:2], -1), rng)
        return tuple(
            LabelledObject(tinted, o.depth_m, _detected(o.mask, rng), o.camera, o.model, o.T_cam_obj) for o in objects
        )

    @lru_cache(maxsize=64)  # noqa: B019 (one training is one process)
    def _frame(self, name: str) -> tuple[NDArray[np.uint8], tuple[LabelledObject, ...]]:
        problem = self._source.problem(name)
        o = problem.observation
        if o.rgb is None:
            raise InputError(f"frame {name} has no colour image; DenseFusion cannot be trained on it")
        objects = tuple(
            LabelledObject(o.rgb, o.depth_m, t.instance.mask, o.camera, t.model, t.instance.T_cam_obj_gt)
            for t in problem.targets
            if t.instance.T_cam_obj_gt is not None and (t.instance.mask & (o.depth_m > 0)).sum() >= LEAST_PX
        )
        return o.rgb, objects


def coloured_scenes(dataset: Path | None, split: str, seed: int, is_halved: bool = False) -> ColouredScenes:
    """What is trained on.

    Args:
        dataset: a BOP folder; None = the objects of the built-in scenes.
        split: its annotated frames; empty = made-up views of its models.
        seed: of the pictures.
        is_halved: as for :class:`MadeUpScenes`.

    Raises:
        VerefineError: the folder is none of a BOP data set, or its models have no colours.
    """
    if dataset is None:
        names = dict.fromkeys(name for scene in demo_names() for name in demo_objects(scene).values())
        models = [demo_model(name, MODEL_POINTS, 0) for name in names]
        by_id = {model.obj_id: model for model in reversed(models)}
        return MadeUpScenes([by_id[k] for k in sorted(by_id)], seed, f"the {len(by_id)} built-in objects", is_halved)
    if split:
        return AnnotatedFrames(dataset, split, seed)
    library = ModelLibrary(dataset, MODEL_POINTS, 0)
    models = [library.get(obj_id) for obj_id in library.ids]
    grey = [model.name for model in models if not model.has_colors]
    if grey:
        raise InputError(f"model {grey[0]} in {library.folder} has no colours; DenseFusion learns from colour")
    return MadeUpScenes(models, seed, f"the {len(models)} models of {dataset.resolve().name}", is_halved)


def every_pixel(camera: Camera, step: int) -> Camera:
    """The camera whose pixels are blocks of step × step of the given one's."""
    # A pixel's centre is at a whole number: that of a block lies (step - 1) / 2 beside its first pixel's.
    K = camera.K / [[step], [step], [1]]
    K[:2, 2] = (camera.K[:2, 2] - (step - 1) / 2) / step
    return Camera(K, camera.width // step, camera.height // step)


def enlarged(image: NDArray, step: int) -> NDArray:
    """Each pixel of an image (H, W, …) as a block of step × step."""
    return image.repeat(step, axis=0).repeat(step, axis=1)


def _viewpoint(rng: np.random.Generator) -> tuple[Float, Camera]:
    view = Viewpoint(
        rng.uniform(-180, 180), rng.uniform(*ELEVATION_DEG), rng.uniform(*DISTANCE_M), (*rng.normal(0, 0.04, 2), 0.04)
    )
    width, height = IMAGE_PX
    focal = float(np.exp(rng.uniform(*np.log(FOCAL_PX))))
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    T = view.T_world_cam
    return T @ transform(axis_angle([0, 0, 1], rng.normal(0, 0.15)), np.zeros(3)), Camera(K, width, height)


def _tinted(rgb: NDArray[np.uint8], labels: NDArray, rng: np.random.Generator) -> NDArray[np.uint8]:
    """The image in another light, what is behind the objects in other colours, with the noise of a camera."""
    light = rng.uniform(0.6, 1.25) * rng.uniform(0.9, 1.1, 3)
    out = rgb * light
    behind = labels < 0
    if not behind.all():
        out[behind] = out[behind] * rng.uniform(0.3, 1.5, 3)
    out += rng.normal(0, rng.uniform(1, 6), rgb.shape)
    return np.clip(np.rint(out), 0, 255).astype(np.uint8)


def _detected(visible: Mask, rng: np.random.Generator) -> Mask:
    """The mask of a detector: right, a little too wide, or a little too narrow."""
    kind, n = rng.random(), int(rng.integers(1, 4))
    if kind < 0.5:
        return visible
    if kind < 0.8:
        return cast(Mask, binary_dilation(visible, iterations=n))
    narrow = cast(Mask, binary_erosion(visible, iterations=n))
    return narrow if narrow.sum() >= LEAST_PX // 2 else visible
