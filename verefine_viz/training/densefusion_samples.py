"""Samples for DenseFusion out of pictures. Same seed and step, same samples."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply, transform
from verefine_viz.learned.densefusion_input import ObjectCrop, crop_of
from verefine_viz.training.coloured_scenes import ColouredScenes, LabelledObject

SCENES_FIRST = 64
"""Pictures of which the first batch is drawn, …"""
SCENES_HELD = 256
"""… and most of them, when the oldest gives way."""
NEW_EVERY = 4
"""Steps after which a picture is added: drawn at half its size it takes as long to make as a step of 8 samples."""
LOSS_POINTS = 100
"""Points of the model that measure how far apart two poses are."""
SHIFT_M = 0.03
"""Points and pose are shifted together by up to this along each axis, as the official training does [m]."""
DRAWS = 2
"""What the second number of a seed stands for; pictures have two numbers."""


@dataclass(frozen=True, eq=False)
class Sample:
    """One object as the networks see it, with its pose."""

    crop: ObjectCrop
    index: int
    """Index of its class."""
    model: NDArray[np.float32]
    """(M, 3) points of the model [m]."""
    wanted: NDArray[np.float32]
    """(M, 3) the same points at the ground truth, in the camera's frame [m]."""
    is_symmetric: bool
    T_cam_obj: NDArray[np.float32]
    """(4, 4) ground truth [m]."""


class TrainingSamples:
    """The samples of a seed, from any step on.

    Args:
        scenes: the pictures.
        seed: of the samples.
        n_points: of the mask, as the networks take them.
        batch_size: samples of a step.
        first_step: the step that :meth:`next` begins with.

    Raises:
        InputError: no picture shows any object.
    """

    def __init__(self, scenes: ColouredScenes, seed: int, n_points: int, batch_size: int, first_step: int = 0) -> None:
        self._scenes, self._seed, self._n_points = scenes, seed, n_points
        self._obj_ids = [model.obj_id for model in scenes.models]
        self._size, self._step = batch_size, first_step
        self._n_made = SCENES_FIRST + first_step // NEW_EVERY
        pictures = (scenes.picture(k) for k in range(max(0, self._n_made - SCENES_HELD), self._n_made))
        self._pictures = deque(pictures, maxlen=SCENES_HELD)
        if not any(self._pictures):
            raise InputError(
                f"none of {len(self._pictures)} pictures shows an object with its pose: {scenes.described}"
            )

    def next(self) -> list[Sample]:
        """The samples of the current step; the next call gives the next step's."""
        rng = np.random.default_rng((self._seed, DRAWS, self._step))
        objects = [o for picture in self._pictures for o in picture]
        samples: list[Sample] = []
        while len(samples) < self._size:
            sample = self._sample(objects[int(rng.integers(len(objects)))], rng)
            samples += [sample] if sample else []
        self._step += 1
        if self._step % NEW_EVERY == 0:
            self._pictures.append(self._scenes.picture(self._n_made))
            self._n_made += 1
        return samples

    def _sample(self, seen: LabelledObject, rng: np.random.Generator) -> Sample | None:
        crop = crop_of(seen.rgb, seen.depth_m, seen.mask, seen.camera, self._n_points, int(rng.integers(2**31)))
        if crop is None:
            return None
        drawn = rng.choice(len(seen.model.points), min(LOSS_POINTS, len(seen.model.points)), replace=False)
        model = seen.model.points[drawn]
        shift = rng.uniform(-SHIFT_M, SHIFT_M, 3)
        points = (crop.points + shift).astype(np.float32)
        T_cam_obj = transform(seen.T_cam_obj[:3, :3], seen.T_cam_obj[:3, 3] + shift)
        return Sample(
            ObjectCrop(crop.image, points, crop.chosen, crop.n_distinct),
            self._obj_ids.index(seen.model.obj_id),
            model.astype(np.float32),
            apply(T_cam_obj, model).astype(np.float32),
            seen.model.is_symmetric,
            T_cam_obj.astype(np.float32),
        )
