"""Trains DenseFusion: PoseNet first, then PoseRefineNet on its poses.

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
from verefine_viz.training.coloured_scenes import ColouredScenes
from verefine_viz.training.course import Course
from verefine_viz.training.densefusion_loss import pose_loss, refine_loss, rotations
from verefine_viz.training.densefusion_samples import Sample, TrainingSamples
from verefine_viz.training.progress_bar import Progress

BATCH_SIZE = 8
"""Samples of a step; their crops differ in size, so they go through the networks one by one."""
POSE_SHARE = 0.75
"""Of the steps; the others train PoseRefineNet, while PoseNet stays as it is."""
REFINE_STEPS = 2
"""Steps of PoseRefineNet that are trained one after the other."""
PEAK_RATE = 5e-4
"""Largest learning rate of either network; it rises over ``WARM_UP`` of its steps and falls to 0 as a cosine does."""
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
    report: Callable[[Progress], None],
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
    pose, refine = PoseNet(len(scenes.obj_ids), size), PoseRefineNet(len(scenes.obj_ids), size)
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
    samples = TrainingSamples(scenes, seed, n_points, batch_size, course.step)

    def state() -> dict[str, Any]:
        return {
            "pose": pose.state_dict(),
            "pose_optimizer": optimizers[0].state_dict(),
            "refine": refine.state_dict(),
            "refine_optimizer": optimizers[1].state_dict(),
        }

    while not course.is_over:
        torch.manual_seed(seed * 2**31 + course.step)  # Of dropout: the same after a stop.
        is_refining, share = phase(course.step, course.n_steps)
        optimizer = optimizers[is_refining]
        for group in optimizer.param_groups:
            group["lr"] = PEAK_RATE * min(1.0, (share + 1e-3) / WARM_UP) * 0.5 * (1.0 + float(np.cos(np.pi * share)))
        optimizer.zero_grad()
        results = []
        for sample in samples.next():
            loss, error = refining_loss(pose, refine, sample) if is_refining else posing_loss(pose, sample)
            (loss / batch_size).backward()
            results.append((float(loss.detach()), float(error)))
        nn.utils.clip_grad_norm_((refine if is_refining else pose).parameters(), LONGEST_GRADIENT)
        optimizer.step()
        course.advance(results, state)
    return TrainedDenseFusion(pose.eval(), refine.eval(), course.step, tuple(course.losses))


def phase(step: int, n_steps: int | None) -> tuple[bool, float]:
    """Whether a step, counted from 0, trains PoseRefineNet, and how much of its network's steps lies before it."""
    if n_steps is None:
        return False, 0.0
    n_pose = max(1, round(POSE_SHARE * n_steps))
    return (False, step / n_pose) if step < n_pose else (True, (step - n_pose) / (n_steps - n_pose))


def posing_loss(pose: PoseNet, sample: Sample) -> tuple[Tensor, Tensor]:
    """PoseNet's loss on a sample, and the ADD(-S) of its most confident pose [m]."""
    pose.train()
    image, points, chosen, index = inputs(sample)
    quats, offsets, confidences, _ = pose(image, points, chosen, index)
    model, wanted = torch.from_numpy(sample.model), torch.from_numpy(sample.wanted)
    return pose_loss(quats, offsets, confidences, points[0], model, wanted, sample.is_symmetric)


def refining_loss(pose: PoseNet, refine: PoseRefineNet, sample: Sample) -> tuple[Tensor, Tensor]:
    """PoseRefineNet's loss from PoseNet's most confident pose on, and the ADD(-S) after its last step [m]."""
    pose.eval()
    image, points, chosen, index = inputs(sample)
    model, wanted = torch.from_numpy(sample.model), torch.from_numpy(sample.wanted)
    with torch.no_grad():
        quats, offsets, confidences, colours = pose(image, points, chosen, index)
        best = confidences.argmax()
        R, t = rotations(quats[best][None])[0], points[0, best] + offsets[best]
        start = torch.from_numpy(sample.T_start)
        R, t = R @ start[:3, :3], t + R @ start[:3, 3]
    total, loss = torch.zeros(()), torch.zeros(())
    for _ in range(REFINE_STEPS):
        # What was at the pose before is now seen from there; the next step begins where this one ends.
        points, wanted = (points - t) @ R, (wanted - t) @ R
        quat, shift = refine(points, colours, index)
        loss = refine_loss(quat, shift, model, wanted, sample.is_symmetric)
        total = total + loss
        R, t = rotations(quat.detach()[None])[0], shift.detach()
    return total, loss.detach()


def inputs(sample: Sample) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """What PoseNet takes of a sample."""
    crop = sample.crop
    arrays = crop.image, crop.points, crop.chosen, np.array([sample.index])
    return tuple(torch.from_numpy(array) for array in arrays)  # pyright: ignore[reportReturnType]
