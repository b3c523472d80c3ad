"""The course of a training: steps and losses, the checkpoint to continue from, and the part of the model card about
them.
"""

# pyright: reportMissingImports=false
from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch

import verefine_viz
from verefine_viz.core.errors import InputError
from verefine_viz.core.writing import atomic

CHECKPOINT_FORMAT = 1
SAVED_EVERY_S = 60.0
"""Time between two checkpoints [s]."""
LOSSES = 20
"""Number of values of the loss curve in a card."""


@dataclass(frozen=True)
class TrainingProgress:
    """Progress of a training."""

    step: int
    n_steps: int | None
    """None until the first steps are timed."""
    loss: float
    """Mean since the last report."""
    error: float
    """Mean remaining error, in the unit of the training."""


@dataclass(eq=False)
class Course:
    """State of a training."""

    checkpoint: Path
    """Written every minute and at the end."""
    made_with: Mapping[str, Any]
    """Arguments with which a training must be started to continue from the checkpoint."""
    n_steps: int | None
    """None = as many as fit into ``minutes``, until the first steps are timed."""
    minutes: float
    timed_steps: tuple[int, int]
    """The steps that are timed for this: from the end of the first to the end of the second."""
    reported_every: int
    """Steps between two reports."""
    report: Callable[[TrainingProgress], None]
    step: int = 0
    losses: list[tuple[int, float, float]] = field(default_factory=list)
    """(step, loss, error), means between reports."""

    def __post_init__(self) -> None:
        self._recent = []
        self._saved_at = self._timed_from = perf_counter()

    @property
    def is_over(self) -> bool:
        return self.n_steps is not None and self.step >= self.n_steps

    def resumed(self) -> dict[str, Any] | None:
        """The state to continue from, with its step taken over; None where there is no checkpoint.

        Raises:
            InputError: it is of another training, or damaged.
        """
        if not self.checkpoint.exists():
            return None
        saved = _read_checkpoint(self.checkpoint, self.made_with, self.n_steps)
        self.step = saved["step"]
        self.n_steps, self.losses = saved["n_steps"], [tuple(row) for row in saved["losses"]]
        return saved

    def advance(self, results: Sequence[tuple[float, float]], state: Callable[[], Mapping[str, Any]]) -> None:
        """Counts a step, and reports and saves when it is time.

        Args:
            results: loss and error of the step, or of each of its samples.
            state: the state to continue from, called only when it is saved.

        Raises:
            InputError: the checkpoint cannot be written.
        """
        self.step += 1
        self._recent += results
        if self.n_steps is None and self.step == self.timed_steps[0]:
            self._timed_from = perf_counter()
        if self.n_steps is None and self.step == self.timed_steps[1]:
            seconds = (perf_counter() - self._timed_from) / (self.timed_steps[1] - self.timed_steps[0])
            self.n_steps = max(self.step, int(60 * self.minutes / seconds))
        if self.step % self.reported_every and self.step != self.n_steps:
            return
        loss, error = (float(x) for x in np.mean(self._recent, axis=0))
        self.losses.append((self.step, loss, error))
        self._recent.clear()
        self.report(TrainingProgress(self.step, self.n_steps, loss, error))
        if self.n_steps is not None and (perf_counter() - self._saved_at > SAVED_EVERY_S or self.is_over):
            course = {"losses": self.losses, "n_steps": self.n_steps, "step": self.step}
            _write_checkpoint(self.checkpoint, self.made_with, {**state(), **course})
            self._saved_at = perf_counter()


def _write_checkpoint(path: Path, made_with: Mapping[str, Any], state: Mapping[str, Any]) -> None:
    """Writes the state of a training, whole or not at all.

    Args:
        path: the file.
        made_with: arguments with which a training must be started to continue from it.
        state: its arrays and numbers; ``step`` and ``n_steps`` are among them.

    Raises:
        InputError: it cannot be written.
    """
    with atomic(path) as part:
        torch.save({"format": CHECKPOINT_FORMAT, "made_with": dict(made_with), **state}, part)


def _read_checkpoint(path: Path, made_with: Mapping[str, Any], n_steps: int | None) -> dict[str, Any]:
    """The state in a checkpoint file.

    Args:
        path: the file.
        made_with: arguments of this training.
        n_steps: how many steps were asked for; None = any number.

    Raises:
        InputError: it is of another training, or damaged.
    """
    try:
        saved = torch.load(path, weights_only=True)  # Only numbers and arrays: nothing is unpickled.
        is_same = (saved["format"], saved["made_with"]) == (CHECKPOINT_FORMAT, dict(made_with))
        seed, planned = saved["made_with"]["seed"], saved["n_steps"]
    except Exception:
        raise InputError(f"checkpoint {path} is damaged, or of another program; delete it to begin again") from None
    if not is_same or n_steps not in (None, planned):
        others = (
            "" if seed != made_with["seed"] or n_steps not in (None, planned) else ", and other data or another size"
        )
        raise InputError(
            f"checkpoint {path} is of a training with seed {seed} and {planned} steps{others}; "
            "give the same, or delete it to begin again"
        )
    return saved


# Parts of a model card.


def losses_on_card(losses: Sequence[tuple[int, float, float]]) -> list[tuple[int, float, float]]:
    """``LOSSES`` evenly spaced (step, loss, error), the last included."""
    every = max(1, len(losses) // LOSSES)
    return list(dict.fromkeys([*losses[::every], *losses[-1:]]))


def versions() -> dict[str, str]:
    """Versions of the software that made the weights."""
    packages = {"verefine-viz": verefine_viz.__version__, "torch": torch.__version__, "numpy": np.__version__}
    return packages | {"python": platform.python_version()}
