"""Numbers as people read them."""

from __future__ import annotations

import math
from typing import Literal

from verefine_viz.diagnosis.causes import TITLES, Cause

DATA_FIRST = "Look at the data first:"
"""Stands before what does not fit together in a frame's data, behind the cause."""
DECLARE = "declare the symmetry in models_info.json if shape is all that matters"
"""What to do where an answer is wrong only by a turn that leaves the object's shape as it is."""
MORE_DIGITS = 3
"""Digits that are added at most to tell two numbers apart."""


def share(error: float) -> str:
    """An error as a share of the diameter."""
    return f"{error:.0%}" if math.isfinite(error) else "no answer"


def told_apart(a: float, b: float, digits: int, kind: Literal["f", "%"] = "f") -> tuple[str, str]:
    """Two numbers with ``digits`` after the point, or as many more as it takes to see that they differ.

    The same text twice if :data:`MORE_DIGITS` more do not tell them apart.
    """
    for n in range(digits, digits + MORE_DIGITS + 1):
        texts = f"{a:.{n}{kind}}", f"{b:.{n}{kind}}"
        if texts[0] != texts[1]:
            return texts
    return f"{a:.{digits}{kind}}", f"{b:.{digits}{kind}}"


def instead(then: float, now: float) -> str:
    """What a re-run changed: "the error is 2% of the diameter instead of 30%"."""
    if not math.isfinite(then):
        return "there is no answer at all"
    if not math.isfinite(now):
        return f"the error is {then:.0%} of the diameter instead of {share(now)}"
    after, before = told_apart(then, now, 0, "%")
    if after == before:
        return f"the error is still {after} of the diameter"
    return f"the error is {after} of the diameter instead of {before}"


def cause_title(cause: str) -> str:
    """A cause as tables and filters show it; one that this version does not know is shown as it is."""
    return TITLES[Cause(cause)] if cause in set(Cause) else cause.replace("_", " ")
