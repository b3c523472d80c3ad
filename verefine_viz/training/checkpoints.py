"""What a training that was stopped goes on from."""

# pyright: reportMissingImports=false
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from verefine_viz.core.errors import InputError
from verefine_viz.core.paths import atomic

CHECKPOINT_FORMAT = 1


def write_checkpoint(path: Path, made_with: Mapping[str, Any], state: Mapping[str, Any]) -> None:
    """Writes the state of a training, whole or not at all.

    Args:
        path: the file.
        made_with: what a training must be started with to go on from it.
        state: its arrays and numbers; ``step`` and ``n_steps`` are among them.

    Raises:
        InputError: it cannot be written.
    """
    with atomic(path) as part:
        torch.save({"format": CHECKPOINT_FORMAT, "made_with": dict(made_with), **state}, part)


def read_checkpoint(path: Path, made_with: Mapping[str, Any], n_steps: int | None) -> dict[str, Any]:
    """The state that was written.

    Args:
        path: the file.
        made_with: what the training was started with now.
        n_steps: how many steps were asked for; None = any number.

    Raises:
        InputError: it is of another training, or damaged.
    """
    try:
        saved = torch.load(path, weights_only=True)  # Numbers and arrays only: nothing is unpickled.
        is_same = (saved["format"], saved["made_with"]) == (CHECKPOINT_FORMAT, dict(made_with))
        seed, planned = saved["made_with"]["seed"], saved["n_steps"]
    except Exception as error:
        raise InputError(
            f"checkpoint {path} cannot be read ({type(error).__name__}); delete it to begin again"
        ) from None
    if not is_same or n_steps not in (None, planned):
        others = (
            "" if seed != made_with["seed"] or n_steps not in (None, planned) else ", and other data or another size"
        )
        raise InputError(
            f"checkpoint {path} is of a training with seed {seed} and {planned} steps{others}; "
            "give the same, or delete it to begin again"
        )
    return saved
