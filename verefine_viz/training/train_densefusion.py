"""Trains DenseFusion: PoseNet as a whole, then without its colour branch in larger batches, then PoseRefineNet.

Same seed, data and number of steps, same weights on the same machine, stopped in between or not.
"""

# pyright: reportMissingImports=false
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from verefine_viz.networks.densefusion_networks import PoseNet, PoseRefineNet, Size
from verefine_viz.training.cached_samples import CachedSamples, SampleBatch, from_camera, from_starts
from verefine_viz.training.coloured_scenes import ColouredScenes
from verefine_viz.training.course import Course, TrainingProgress
from verefine_viz.training.densefusion_loss import pose_loss, refine_loss, rotations
from verefine_viz.training.densefusion_samples import Sample, TrainingSamples

BATCH_SIZE = 8
"""Samples of a step of the whole; their crops differ in size, so they go through the network one by one."""
WHOLE, HEADS, REFINER = 0, 1, 2
"""Parts of a training: all of PoseNet; its layers after the colour branch, which stays; PoseRefineNet."""
SHARES = (0.35, 0.4, 0.25)
"""Shares of the steps that each part has."""
REFINE_STEPS = 2
"""Steps of PoseRefineNet that are trained one after the other."""
PEAK_RATE = 1e-3
"""Largest learning rate of each part; it rises over ``WARM_UP`` of its steps and falls to 0 as a cosine does."""
WARM_UP = 0.02
LONGEST_GRADIENT = 1.0
TIMED_STEPS = (3, 8)
"""The steps that are timed to make a number of steps of a number of minutes."""
REPORTED_EVERY = 10
"""Steps between two reports."""


@dataclass(frozen=True, eq=False)
class TrainedDenseFusion:
    """What a training results in."""

    pose: PoseNet
    refine: PoseRefineNet
    n_steps: int
    losses: tuple[tuple[int, float, float], ...]
    """(step, loss, ADD(-S) [m]), means between reports."""


def train_densefusion(
    scenes: ColouredScenes,
    size: Size,
    n_points: int,
    seed: int,
    n_steps: int | None,
    minutes: float,
    checkpoint: Path,
    report: Callable[[TrainingProgress], None],
    batch_size: int = BATCH_SIZE,
) -> TrainedDenseFusion:
    """Trains from the checkpoint, if there is one, or from the start.

    Args:
        scenes: the pictures.
        size: of the networks.
        n_points: of the mask, that they take.
        seed: of weights and samples.
        n_steps: how many steps; None = as many as fit into ``minutes`` at the speed of the first ones.
        minutes: see ``n_steps``.
        checkpoint: written every minute; it goes on from there.
        report: called every few steps.
        batch_size: samples of a step.

    Raises:
        InputError: the checkpoint is of another training, or damaged; or no picture shows an object.
    """
    torch.set_num_threads(1)  # Sums depend on the number of threads.
    torch.manual_seed(seed)
    pose, refine = PoseNet(len(scenes.models), size), PoseRefineNet(len(scenes.models), size)
    for layer in pose.cnn.modules():
        if isinstance(layer, nn.Conv2d):
            # Torch's own start lets colours fade from layer to layer, and nothing normalises them.
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    optimizers = [torch.optim.Adam(net.parameters(), PEAK_RATE) for net in (pose, refine)]
    made_with = {"seed": seed, "batch_size": batch_size, "n_points": n_points, "data": scenes.described}
    made_with["parameters"] = sum(p.numel() for p in pose.parameters())
    course = Course(checkpoint, made_with, n_steps, minutes, TIMED_STEPS, REPORTED_EVERY, report)
    saved = course.resumed()
    for net, optimizer, name in zip((pose, refine), optimizers, ("pose", "refine"), strict=True):
        if saved is not None:
            net.load_state_dict(saved[name])
            optimizer.load_state_dict(saved[f"{name}_optimizer"])
    samples: TrainingSamples | None = None
    cached: CachedSamples | None = None
    cached_part = WHOLE

    def state() -> dict[str, Any]:
        return {
            "pose": pose.state_dict(),
            "pose_optimizer": optimizers[0].state_dict(),
            "refine": refine.state_dict(),
            "refine_optimizer": optimizers[1].state_dict(),
        }

    while not course.is_over:
        torch.manual_seed(seed * 2**31 + course.step)  # Of dropout: the same after a stop.
        part, began_at, share = phase(course.step, course.n_steps)
        network, optimizer = (refine, optimizers[1]) if part == REFINER else (pose, optimizers[0])
        for group in optimizer.param_groups:
            group["lr"] = PEAK_RATE * min(1.0, (share + 1e-3) / WARM_UP) * 0.5 * (1.0 + float(np.cos(np.pi * share)))
        optimizer.zero_grad()
        results = []
        if part == WHOLE:
            samples = samples or TrainingSamples(scenes, seed, n_points, batch_size, course.step)
            pose.train()
            for sample in samples.next():
                loss, error = _whole_loss(pose, sample)
                (loss / batch_size).backward()
                results.append((float(loss.detach()), float(error)))
        else:
            if cached_part != part:
                cached_part = part
                cached = CachedSamples(pose.eval(), scenes, seed, n_points, batch_size, began_at, course.step)
            assert cached is not None
            drawn = cached.next()
            loss, error = (
                refiner_loss(refine, from_starts(*drawn)) if part == REFINER else _heads_loss(pose, from_camera(*drawn))
            )
            loss.backward()
            results.append((float(loss.detach()), float(error)))
        nn.utils.clip_grad_norm_(network.parameters(), LONGEST_GRADIENT)
        optimizer.step()
        course.advance(results, state)
    return TrainedDenseFusion(pose.eval(), refine.eval(), course.step, tuple(course.losses))


def phase(step: int, n_steps: int | None) -> tuple[int, int, float]:
    """What a step, counted from 0, trains, the step that this begins with, and how much of it lies before."""
    if n_steps is None:
        return WHOLE, 0, 0.0
    ends = [round(n_steps * float(share)) for share in np.cumsum(SHARES)]
    part = next(k for k, end in enumerate(ends) if step < end)
    began_at = ends[part - 1] if part else 0
    return part, began_at, (step - began_at) / (ends[part] - began_at)


def _whole_loss(pose: PoseNet, sample: Sample) -> tuple[Tensor, Tensor]:
    """PoseNet's loss on a sample, and the ADD(-S) of its most confident pose [m]."""
    image, points, chosen, index = inputs(sample)
    quats, offsets, confidences, _ = pose(image, points, chosen, index)
    model, wanted = torch.from_numpy(sample.model)[None], torch.from_numpy(sample.wanted)[None]
    is_symmetric = torch.tensor([sample.is_symmetric])
    return pose_loss(quats[None], offsets[None], confidences[None], points, model, wanted, is_symmetric)


def _heads_loss(pose: PoseNet, batch: SampleBatch) -> tuple[Tensor, Tensor]:
    """PoseNet's loss on a batch whose colours are described, and the mean ADD(-S) of its most confident poses [m]."""
    answers = pose.poses(batch.points, batch.colours, batch.index)
    return pose_loss(*answers, batch.points, batch.models, batch.wanted, batch.is_symmetric)


def refiner_loss(refine: PoseRefineNet, batch: SampleBatch) -> tuple[Tensor, Tensor]:
    """PoseRefineNet's loss on a batch, summed over its steps, and the mean ADD(-S) after the last [m]."""
    points, wanted = batch.points, batch.wanted
    total, left = torch.zeros(()), torch.zeros(())
    for _ in range(REFINE_STEPS):
        quats, shifts = refine.steps(points, batch.colours, batch.index)
        left = refine_loss(quats, shifts, batch.models, wanted, batch.is_symmetric)
        total = total + left
        # What was at the pose before is now seen from there; the next step begins where this one ends.
        Rs, ts = rotations(quats.detach()), shifts.detach()[:, None]
        points, wanted = (points - ts) @ Rs, (wanted - ts) @ Rs
    return total, left.detach()


def inputs(sample: Sample) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """What PoseNet takes of a sample."""
    crop = sample.crop
    arrays = crop.image, crop.points, crop.chosen, np.array([sample.index])
    return tuple(torch.from_numpy(array) for array in arrays)  # pyright: ignore[reportReturnType]
