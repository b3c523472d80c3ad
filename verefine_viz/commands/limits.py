"""How many workers and seeds, and how much memory, a person may ask for."""

from __future__ import annotations

import math
import os

from verefine_viz.core.errors import SettingsError, quoted

MOST_PER_CORE = 4
"""More than the cores save no time, and a process takes up to 1 GB; a few more do no harm."""
MOST_SEEDS = 1000
"""Of a sweep or a study; the paper has 10 to 20 repetitions."""
MOST_MEMORY_GB = 100_000


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


def check_seeds(n: int | None) -> None:
    """
    Raises:
        SettingsError: a number is given that is below 1 or above :data:`MOST_SEEDS`.
    """
    if n is not None and n < 1:
        raise SettingsError(f"--seeds is {n}, expected 1 or more")
    if n is not None and n > MOST_SEEDS:
        raise SettingsError(f"--seeds is {quoted(n)}, expected {MOST_SEEDS} or fewer")


def check_memory(gigabytes: float | None) -> None:
    """
    Raises:
        SettingsError: an amount is given that is not above 0, or is above :data:`MOST_MEMORY_GB`.
    """
    if gigabytes is None:
        return
    if not gigabytes > 0:
        raise SettingsError(f"--worker-memory-gb is {gigabytes:g}, expected more than 0")
    if math.isinf(gigabytes) or gigabytes > MOST_MEMORY_GB:
        raise SettingsError(
            f"--worker-memory-gb is {gigabytes:g}, expected {MOST_MEMORY_GB} or less; leave it out to share this "
            "machine's memory"
        )
