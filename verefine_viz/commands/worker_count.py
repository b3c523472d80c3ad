"""How many workers a person may ask for."""

from __future__ import annotations

import os

from verefine_viz.core.errors import SettingsError

MOST_PER_CORE = 4
"""More than the cores save no time, and a process takes up to 1 GB; a few more are nobody's mistake."""


def check_workers(n: int) -> None:
    """
    Raises:
        SettingsError: there are none, or more than this machine can use.
    """
    if n < 1:
        raise SettingsError(f"--workers is {n}, expected 1 or more")
    cores = os.cpu_count() or 1
    if n > MOST_PER_CORE * cores:
        raise SettingsError(
            f"--workers is {n}, expected {MOST_PER_CORE * cores} or fewer, {MOST_PER_CORE} for each core of this "
            "machine: more of them take memory and save no time"
        )
