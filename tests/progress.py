"""A token that ends, and progress that remembers what it was told."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from verefine_viz.core.errors import Cancelled
from verefine_viz.core.progress_token import ProgressToken


def hearing(said: list[str]) -> ProgressToken:
    """Endless; notes what is begun."""
    return ProgressToken(lambda doing, share: said.append(doing) if doing else None)


def ending_after(n: int) -> ProgressToken:
    """It is asked for ``n`` times in vain."""
    left = iter(range(n))
    return ProgressToken(is_wanted=lambda: next(left, None) is not None)


def asked(work: Callable[[ProgressToken], object]) -> int:
    """How often ``work`` asks at its checkpoints."""
    asks: list[None] = []
    work(ProgressToken(is_wanted=lambda: not asks.append(None)))
    return len(asks)


def cancelled_everywhere(work: Callable[[ProgressToken], object], n: int, most: int = 12) -> Iterator[int]:
    """Has ``work``, which asks ``n`` times, cancelled at that many of its asks, from the first to the last."""
    for k in sorted({round(i * (n - 1) / (most - 1)) for i in range(most)}):
        with pytest.raises(Cancelled):
            work(ending_after(k))
        yield k


class Countdown:
    """A token that can be wound up again."""

    def __init__(self) -> None:
        self.left: int | None = None
        """Asks until it ends; None = endless."""
        self.progress = ProgressToken(is_wanted=self._is_left)

    def _is_left(self) -> bool:
        if self.left is None:
            return True
        self.left -= 1
        return self.left >= 0
