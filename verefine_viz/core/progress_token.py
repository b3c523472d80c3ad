"""Reports from long work, and its cancellation once its result is no longer wanted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.errors import Cancelled

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class ProgressToken:
    """Carries reports to, and cancellation from, the caller. It never changes a result, only whether there is one.

    Long work calls :meth:`checkpoint` between its natural units (objects, meshes, batches of votes), a few times a
    second where it can, and before it stores or writes anything, so cancelling leaves nothing half done.
    """

    report: Callable[[str, float | None], None] = lambda doing, share: None
    """Gets what is being done ("" = the same as before) and how much of it is done [0 to 1], None = unknown."""
    is_wanted: Callable[[], bool] = lambda: True
    """False once the work is cancelled."""
    report_once: Callable[[str], None] = lambda doing: None
    """Gets only work that may take a minute, happens once and is cached on disk: all that a batch of hundreds of frames
    shows."""
    preparing: Callable[[], AbstractContextManager[object]] = nullcontext
    """Entered while models are read and prepared, which later frames need not repeat; measures that time."""
    seen: Callable[[NDArray[np.uint8] | None], None] = lambda rgb: None
    """Gets the photo of a frame (H, W, 3), None = it has none, as soon as it is read: before anything is prepared."""

    def checkpoint(self, doing: str = "", share: float | None = None) -> None:
        """Report what is done next, or how much of it is done, where either is given.

        Raises:
            Cancelled: the result is not wanted any more.
        """
        if not self.is_wanted():
            raise Cancelled
        if doing or share is not None:
            self.report(doing, share)

    def announce(self, doing: str) -> None:
        """A checkpoint before something that may take a minute, happens once and is cached on disk.

        Raises:
            Cancelled: the result is not wanted any more.
        """
        self.checkpoint(doing)
        self.report_once(doing)

    def over(self, items: Sequence[T], doing: str = "") -> Iterator[T]:
        """The items one by one, with a checkpoint before each.

        Raises:
            Cancelled: the result is not wanted any more.
        """
        for k, item in enumerate(items):
            self.checkpoint(doing if k == 0 else "", k / len(items))
            yield item


NEVER_CANCELLED = ProgressToken()
"""Token for callers that wait until the end and need no reports."""
