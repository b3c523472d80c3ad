"""Samples for DenseFusion with precomputed colour features, in large batches.

The colour branch takes nearly all of the time of a sample. Once it is trained, its features are computed once per
sample, and the rest of PoseNet, and then PoseRefineNet, learn from them in batches of ``BATCH_SIZE`` that cost no more
than a few samples did before. Same seed and step, same batches.
"""

# pyright: reportMissingImports=false
from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.networks.densefusion_networks import PoseNet
from verefine_viz.training.coloured_scenes import ColouredScenes
from verefine_viz.training.densefusion_loss import rotations
from verefine_viz.training.densefusion_samples import Sample, TrainingSamples

BATCH_SIZE = 64
"""Samples of a step."""
BATCHES_HELD = 512
"""Number of cached batches, from which the samples of a step are drawn; the oldest is replaced …"""
NEW_EVERY = 2
"""… by a new one after this many steps."""
POINTS_DRAWN = 48
"""Number of points of a sample, drawn again each time."""
MODEL_POINTS_DRAWN = 50
"""Number of points that measure the distance between two poses."""
POSE_NETS = 0.5
"""Share of starts of PoseRefineNet at PoseNet's pose; the others are at the ground truth, …"""
TURN_DEG, AWAY_M = 30.0, 0.03
"""… turned and shifted by up to these amounts."""
DRAWS = 3
"""Meaning of the second number of a seed, as in ``densefusion_samples.DRAWS``."""


@dataclass(frozen=True, eq=False)
class CachedSample:
    """A sample with the part that PoseNet computes."""

    sample: Sample
    colours: NDArray[np.float32]
    """(E, N) features by the colour branch."""
    T_pose_net: NDArray[np.float32]
    """(4, 4) PoseNet's most confident pose [m]."""


@dataclass(frozen=True, eq=False)
class SampleBatch:
    """A batch of samples in the form that the networks take."""

    points: Tensor
    """(B, N, 3) [m], in the camera's frame, or in that of a pose."""
    colours: Tensor
    """(B, E, N)."""
    index: Tensor
    """(B,) number of each object's class."""
    models: Tensor
    """(B, M, 3) points of the models [m]."""
    wanted: Tensor
    """(B, M, 3) the same at the ground truth, in the frame of ``points`` [m]."""
    is_symmetric: Tensor
    """(B,)"""


class CachedSamples:
    """Draws the samples of a seed, from any step on.

    Args:
        pose: PoseNet, whose colour branch stays as it is.
        scenes: the pictures.
        seed: of the samples and of what is drawn from them.
        n_points: of the mask.
        batch_size: number of samples that are added at a time.
        began_at: first step of this part of the training, with which its samples begin.
        first_step: the step that :meth:`next` begins with.

    Raises:
        InputError: no picture shows any object.
    """

    def __init__(
        self,
        pose: PoseNet,
        scenes: ColouredScenes,
        seed: int,
        n_points: int,
        batch_size: int,
        began_at: int,
        first_step: int,
    ) -> None:
        self._pose, self._seed, self._step = pose, seed, first_step
        # Number of batches added before; those still cached are made again.
        n_added = BATCHES_HELD + (first_step - began_at + NEW_EVERY - 1) // NEW_EVERY
        self._began_at = began_at
        self._samples = TrainingSamples(scenes, seed, n_points, batch_size, began_at + n_added - BATCHES_HELD)
        self._held: deque[list[CachedSample]] = deque(maxlen=BATCHES_HELD)
        for _ in range(BATCHES_HELD):
            self._add()

    def next(self) -> tuple[list[CachedSample], np.random.Generator]:
        """The cached samples of the current step, and the generator that draws from them; the next call gives the next
        step's.
        """
        if (self._step - self._began_at) % NEW_EVERY == 0:
            self._add()
        rng = np.random.default_rng((self._seed, DRAWS, self._step))
        self._step += 1
        every = [sample for batch in self._held for sample in batch]
        return [every[int(k)] for k in rng.integers(len(every), size=BATCH_SIZE)], rng

    def _add(self) -> None:
        self._held.append([cached(self._pose, sample) for sample in self._samples.next()])


def cached(pose: PoseNet, sample: Sample) -> CachedSample:
    """The sample with the part that PoseNet computes, as it is now."""
    crop = sample.crop
    arrays = crop.image, crop.points, crop.chosen, np.array([sample.index])
    with torch.no_grad():
        quats, offsets, confidences, colours = pose(*(torch.from_numpy(array) for array in arrays))
        best = int(confidences.argmax())
        R = rotations(quats[best][None])[0].numpy()
    T = transform(R, crop.points[0, best] + offsets[best].numpy())
    return CachedSample(sample, colours[0].numpy(), T.astype(np.float32))


def from_camera(samples: list[CachedSample], rng: np.random.Generator) -> SampleBatch:
    """For PoseNet."""
    return _batch(samples, [np.eye(4, dtype=np.float32)] * len(samples), rng)


def from_starts(samples: list[CachedSample], rng: np.random.Generator) -> SampleBatch:
    """For PoseRefineNet."""
    return _batch(samples, [_start(sample, rng) for sample in samples], rng)


def _start(sample: CachedSample, rng: np.random.Generator) -> NDArray[np.float32]:
    """The pose (4, 4) that PoseRefineNet starts from."""
    if rng.random() < POSE_NETS:
        return sample.T_pose_net
    turn = axis_angle(random_unit_vector(rng), np.deg2rad(rng.uniform(0, TURN_DEG)))
    away = random_unit_vector(rng) * rng.uniform(0, AWAY_M)
    return (sample.sample.T_cam_obj @ transform(turn, away)).astype(np.float32)


def _batch(samples: list[CachedSample], seen_from: list[NDArray[np.float32]], rng: np.random.Generator) -> SampleBatch:
    """Some points of the samples, in the frames of poses (4, 4)."""
    points, colours, models, wanted = [], [], [], []
    for one, T in zip(samples, seen_from, strict=True):
        drawn = rng.integers(one.colours.shape[1], size=POINTS_DRAWN)
        points.append((one.sample.crop.points[0, drawn] - T[:3, 3]) @ T[:3, :3])
        colours.append(one.colours[:, drawn])
        drawn = rng.integers(len(one.sample.model), size=MODEL_POINTS_DRAWN)
        models.append(one.sample.model[drawn])
        wanted.append((one.sample.wanted[drawn] - T[:3, 3]) @ T[:3, :3])
    arrays = [torch.from_numpy(np.stack(part)) for part in (points, colours, models, wanted)]
    index = torch.tensor([one.sample.index for one in samples])
    is_symmetric = torch.tensor([one.sample.is_symmetric for one in samples])
    return SampleBatch(arrays[0], arrays[1], index, arrays[2], arrays[3], is_symmetric)
