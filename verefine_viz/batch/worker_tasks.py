"""What workers of every kind are given: their work, and one thread to use. Imports nothing: see ``worker_process``."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, Literal, Protocol, TypeVar

if TYPE_CHECKING:
    from verefine_viz.core.progress_token import ProgressToken

ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that are set to 1 before a worker loads numpy or numba."""

MOST_PER_CORE = 4
"""More workers than the cores save no time, and a process takes up to 1 GB; a few more do no harm."""
TaskName = Literal["solve", "explain", "estimate"]
"""What workers do with a frame: solve it; solve it and explain wrong answers; only make initial poses."""

Item = TypeVar("Item", bound=Hashable, contravariant=True)
Result = TypeVar("Result", covariant=True)


class Work(Protocol[Item, Result]):
    """What worker processes do with items. It is sent to them, so it is small; equal ones are interchangeable."""

    def begin(self, progress: ProgressToken) -> Callable[[Item, Callable[[], None]], Result]:
        """Make the tools, in a worker.

        Returns:
            A function from an item to its result, which never raises. It calls its second argument whenever a kernel is
            about to be compiled. Results are no sentences (str), which stand for what is taking long.
        """
        ...

    def lost(self, item: Item, why: str) -> Result:
        """The result of an item whose worker died each time."""
        ...

    def line_of(self, item: Item) -> Hashable:
        """The line of an item: those of one line are solved one after the other; None = at any time."""
        ...
