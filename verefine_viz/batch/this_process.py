"""Frames of a batch solved in this process, one after the other: where parts of the caller's program live."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.core.progress_token import NEVER_CANCELLED
from verefine_viz.run.record import RunRecord


class ThisProcess:
    """Workers in this process: see :class:`verefine_viz.batch.run_batch.Workers`."""

    needs = warning = ""

    def __init__(self, work: FrameWork) -> None:
        self._work = work

    def solve(self, frames: Iterable[str]) -> Iterator[RunRecord | str | None]:
        """The results of ``frames``, in their order."""
        solve = self._work.begin(NEVER_CANCELLED)
        for frame in frames:
            yield solve(frame, lambda: None)

    def close(self) -> None:
        """Do nothing: there is no process to end."""
