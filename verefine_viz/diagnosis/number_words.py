"""Numbers in the sentences of findings: as many digits as matter, or as it takes to see that two differ."""

from __future__ import annotations

import math
from typing import Literal

MORE_DIGITS = 3
"""Most digits that are added to make two numbers differ."""


def share(error: float) -> str:
    """An error, given as a share of the diameter, in percent."""
    return f"{error:.0%}" if math.isfinite(error) else "no answer"


def distinct_texts(a: float, b: float, digits: int, kind: Literal["f", "%"] = "f") -> tuple[str, str]:
    """Two numbers with ``digits`` after the point, or as many more as it takes to see that they differ.

    The same text twice if :data:`MORE_DIGITS` more do not show it.
    """
    for n in range(digits, digits + MORE_DIGITS + 1):
        texts = f"{a:.{n}{kind}}", f"{b:.{n}{kind}}"
        if texts[0] != texts[1]:
            return texts
    return f"{a:.{digits}{kind}}", f"{b:.{digits}{kind}}"


def millimetres(mm: float) -> str:
    """A length with as many digits as matter."""
    return f"{mm:.1f} mm" if mm < 99.95 else f"{mm:.0f} mm"


def instead(then: float, now: float) -> str:
    """What a re-run changed: "the error is 2% of the diameter instead of 30%"."""
    if not math.isfinite(then):
        return "there is no answer at all"
    if not math.isfinite(now):
        return f"the error is {then:.0%} of the diameter instead of {share(now)}"
    after, before = distinct_texts(then, now, 0, "%")
    if after == before:
        return f"the error is still {after} of the diameter"
    return f"the error is {after} of the diameter instead of {before}"
