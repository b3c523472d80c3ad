"""Numbers as people read them."""

from __future__ import annotations

import math


def share(error: float) -> str:
    """An error as a share of the diameter."""
    return f"{error:.0%}" if math.isfinite(error) else "no answer"


def instead(then: float, now: float) -> str:
    """What a re-run changed: "the error is 2% of the diameter instead of 30%"."""
    if not math.isfinite(then):
        return "there is no answer at all"
    return f"the error is {then:.0%} of the diameter instead of {share(now)}"
