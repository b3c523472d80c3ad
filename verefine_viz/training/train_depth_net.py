"""Trains ``depth_net``: same seed and number of steps, same weights on the same machine, stopped in between or not."""

# pyright: reportMissingImports=false
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from verefine_viz.training.course import Course, TrainingProgress
from verefine_viz.training.depth_net_model import DepthNetModel, loss_of
from verefine_viz.training.depth_net_samples import TrainingBatches

BATCH_SIZE = 128
PEAK_RATE = 2e-3
"""Largest learning rate; it rises to it over ``WARM_UP`` steps and then falls to 0 as a cosine does."""
WARM_UP = 200
WEIGHT_DECAY = 1e-4
AVERAGED = 0.998
"""Share of the averaged weights that a step leaves, once there were many steps: the average is what is exported."""
TIMED_STEPS = (5, 25)
"""The steps that are timed to make a number of steps of a number of minutes."""
REPORTED_EVERY = 20
"""Steps between two reports."""


@dataclass(frozen=True, eq=False)
class Trained:
    """What a training results in."""

    model: nn.Module
    n_steps: int
    losses: tuple[tuple[int, float, float], ...]
    """(step, loss, error [radii]), means between reports."""


def train(
    seed: int,
    n_steps: int | None,
    minutes: float,
    checkpoint: Path,
    report: Callable[[TrainingProgress], None],
    batch_size: int = BATCH_SIZE,
) -> Trained:
    """Trains from the checkpoint, if there is one, or from the start.

    Args:
        seed: of weights and data.
        n_steps: how many steps; None = as many as fit into ``minutes`` at the speed of the first ones.
        minutes: see ``n_steps``.
        checkpoint: written every minute; it goes on from there.
        report: called every few steps.
        batch_size: crops of a step.

    Raises:
        InputError: the checkpoint is of another training, or damaged.
    """
    torch.set_num_threads(1)  # Sums over pixels depend on the number of threads.
    torch.manual_seed(seed)
    model = DepthNetModel().to(memory_format=torch.channels_last)  # pyright: ignore
    average = AveragedModel(model, avg_fn=averaged, use_buffers=True)
    optimizer = torch.optim.AdamW(model.parameters(), weight_decay=WEIGHT_DECAY)
    made_with = {"seed": seed, "batch_size": batch_size}
    course = Course(checkpoint, made_with, n_steps, minutes, TIMED_STEPS, REPORTED_EVERY, report)
    saved = course.resumed()
    if saved is not None:
        model.load_state_dict(saved["model"])
        average.load_state_dict(saved["average"])
        optimizer.load_state_dict(saved["optimizer"])
    batches = TrainingBatches(seed, batch_size, course.step)

    def state() -> dict[str, Any]:
        return {"model": model.state_dict(), "average": average.state_dict(), "optimizer": optimizer.state_dict()}

    model.train()
    while not course.is_over:
        batch = batches.next()
        crops, points, wanted = (torch.from_numpy(a) for a in (batch.crops, batch.points, batch.wanted))
        loss, error = loss_of(model(crops.to(memory_format=torch.channels_last)), points, wanted)
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(course.step, course.n_steps)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        average.update_parameters(model)
        course.advance([(float(loss.detach()), float(error))], state)
    return Trained(average.module.eval(), course.step, tuple(course.losses))


def averaged(average: Tensor, latest: Tensor, n_averaged: Tensor | int) -> Tensor:
    """The average after another step; at first it forgets quickly: a short training exports no early weights."""
    n = int(n_averaged)
    return average + (latest - average) * (1.0 - min(AVERAGED, (1 + n) / (10 + n)))


def learning_rate(step: int, n_steps: int | None) -> float:
    """Learning rate of a step, counted from 0."""
    rising = min(1.0, (step + 1) / WARM_UP)
    done = 0.0 if n_steps is None else step / n_steps
    return PEAK_RATE * rising * 0.5 * (1.0 + float(np.cos(np.pi * done)))
