"""Frames of a batch solved in this process, one after the other: where parts of the caller's program live."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from time import monotonic

from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.pace import Pace
from verefine_viz.core.progress_token import NEVER_CANCELLED
from verefine_viz.run.kernel_compilation import COMPILING
from verefine_viz.run.record import RunRecord


class ThisProcess:
    """See :class:`verefine_viz.batch.run_batch.Workers`."""

    needs = warning = ""

    def __init__(self, work: FrameWork) -> None:
        self._work = work

    def solve(self, frames: Iterable[str], pace: Pace) -> Iterator[RunRecord | str | None]:
        """The results of ``frames``, in their order."""
        solve = self._work.begin(NEVER_CANCELLED)
        for frame in frames:
            pace.begin(frame, monotonic())
            result = solve(frame, lambda frame=frame: pace.slow_down(frame, COMPILING))
            pace.end(frame, monotonic(), self._work.end_of(result))
            yield result

    def close(self) -> None:
        """Nothing is left running."""
