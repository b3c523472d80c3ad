"""How many decimals a sentence needs, so that what it compares can be told apart."""

from __future__ import annotations


def telling_digits(lead: float) -> int:
    """As many decimals as it takes to see that one of two numbers, or of two sums of two, is larger by ``lead`` ≥ 0.

    Two where that shows, or where nothing does; six at most.
    """
    return next((n for n in (2, 3, 4, 5) if lead >= 3 * 10.0**-n), 6 if lead > 0 else 2)
