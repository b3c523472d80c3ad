"""Numbers as people read them."""

from __future__ import annotations

import math

from verefine_viz.diagnosis.causes import TITLES, Cause


def share(error: float) -> str:
    """An error as a share of the diameter."""
    return f"{error:.0%}" if math.isfinite(error) else "no answer"


def instead(then: float, now: float) -> str:
    """What a re-run changed: "the error is 2% of the diameter instead of 30%"."""
    if not math.isfinite(then):
        return "there is no answer at all"
    return f"the error is {then:.0%} of the diameter instead of {share(now)}"


def cause_title(cause: str) -> str:
    """A cause as tables and filters show it; one that this version does not know is shown as it is."""
    return TITLES[Cause(cause)] if cause in set(Cause) else cause.replace("_", " ")
