"""While something else is made ready, people may look around in what is open."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from verefine_viz.viewer import commands as c
from verefine_viz.viewer import side_commands as s
from verefine_viz.viewer.command import Command
from verefine_viz.viewer.requests import Requests

LONG = (
    c.OpenFrame, c.OpenAt, c.OpenDemo, c.OpenSession, c.OpenFailure, c.OpenPoint, c.Restart, c.Estimate,
    c.Export, s.OpenRecording, s.CompareRun, s.CompareRecording,
)  # fmt: skip
"""What may take long, and changes nothing that is open before it is done."""
LOOKING = (
    c.Back, c.Seek, c.SeekStage, c.SeekEnd, c.SeekEvent, c.Focus, c.ShowScene, c.SelectArm, c.Compare, c.ShowMap,
    c.ProbePixel, c.ColorCloud, c.ShowLayer, c.ScrubPath, c.SortBatch, c.FilterBatch, c.TurnPage, s.ShowSide,
    s.ShowSidePoses, s.SeekMoment,
)  # fmt: skip
"""What neither computes anything of a run nor changes what is open."""


class Meanwhile:
    """What the worker does besides a command that takes long, each time it is asked whether that is still wanted.

    Args:
        requests: where people ask for things.
        look_around: carries out one of ``LOOKING``, and shows it.
    """

    def __init__(self, requests: Requests, look_around: Callable[[Command], None]) -> None:
        self._requests, self._look_around = requests, look_around
        self._worker: int | None = None
        """The thread that may look around; None = nothing takes long, or it looks around already."""

    @contextmanager
    def cancellable(self, command: object) -> Iterator[None]:
        """What the worker does inside may be left undone; if it is ``LONG``, people look around meanwhile."""
        self._worker = threading.get_ident() if isinstance(command, LONG) else None
        try:
            with self._requests.cancellable():
                yield
        finally:
            self._worker = None

    def is_wanted(self) -> bool:
        """Whether what the worker is at is still wanted."""
        if self._worker == threading.get_ident():
            worker, self._worker = self._worker, None
            while (command := self._requests.take_one_of(LOOKING)) is not None:
                self._look_around(command)
            self._worker = worker
        return self._requests.are_wanted
