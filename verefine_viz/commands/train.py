"""``verefine-viz train``: trains a network of the learned refiners on made-up views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from verefine_viz.core.errors import SettingsError, UnavailableError
from verefine_viz.core.writing import check_file

NEEDED = ("torch", "onnx", "onnxscript")
"""Packages of the extra ``torch``."""
MOST_STEPS, MOST_MINUTES, MOST_POINTS = 10_000_000, 100_000, 10_000


@dataclass(frozen=True)
class TrainCommand:
    """Train a network on made-up views, on one processor core. Stopped or killed, the same command goes on."""

    network: Annotated[Literal["depth_net", "densefusion"], tyro.conf.Positional]
    """depth_net: the depth refiner that knows no object. densefusion: both networks of it, for given objects."""
    out: Path
    """ONNX file; its model card goes beside it as JSON, and a checkpoint until training is
    done. The refiner of densefusion goes to the same name with _refine."""
    minutes: float = 25.0
    """How long it trains: the number of steps follows from the speed of the first ones."""
    steps: int | None = None
    """Number of steps instead; with the same seed it gives the same weights again on the same machine."""
    seed: int = 0
    """Seed of weights and views."""
    dataset: Path | None = None
    """densefusion: folder of a BOP data set whose models it learns; without, it learns the objects of the built-in
    scenes."""
    split: str = ""
    """densefusion: split of the data set with annotated frames (train_pbr, train_real); empty = made-up views of its
    models."""
    slim: bool = True
    """densefusion: small networks (1.7 million parameters) for a processor, or with --no-slim the official ones (23
    million)."""
    points: int = 500
    """densefusion: points of a mask that the networks see."""

    def run(self, arguments: Sequence[str]) -> int:
        check_file(self.out, "depth_net.onnx")
        if self.out.suffix != ".onnx":
            raise SettingsError(f"--out is {self.out}, expected a name that ends in .onnx")
        if not 0 < self.minutes <= MOST_MINUTES:
            raise SettingsError(f"--minutes is {self.minutes:g}, expected more than 0 and at most {MOST_MINUTES}")
        if self.steps is not None and not 1 <= self.steps <= MOST_STEPS:
            raise SettingsError(f"--steps is {self.steps}, expected from 1 to {MOST_STEPS}")
        if not 0 <= self.seed < 2**32:
            raise SettingsError(f"--seed is {self.seed}, expected from 0 to {2**32 - 1}")
        if not 2 <= self.points <= MOST_POINTS:
            raise SettingsError(f"--points is {self.points}, expected from 2 to {MOST_POINTS}")
        if self.network == "depth_net" and self.dataset is not None:
            raise SettingsError("--dataset is read by train densefusion only; depth_net knows no object")
        if self.split and self.dataset is None:
            raise SettingsError("--split is set without --dataset; name the folder of the BOP data set")
        try:
            from verefine_viz.training.densefusion_command import train_both
            from verefine_viz.training.depth_net_command import train_depth_net
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] not in NEEDED:
                raise
            raise UnavailableError(
                f"training needs {error.name}: pip install 'verefine-viz[torch]' "
                "(the weights of the package need nothing more)"
            ) from None
        if self.network == "densefusion":
            return train_both(
                self.out, self.slim, self.dataset, self.split, self.points, self.seed, self.steps, self.minutes
            )
        return train_depth_net(self.out, self.seed, self.steps, self.minutes)
