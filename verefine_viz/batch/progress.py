"""How far a batch is: frames done, time left, how good so far."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console

from verefine_viz.core.console import ProgressBar

if TYPE_CHECKING:
    from verefine_viz.batch.run_batch import BatchStatus


class BatchProgress:
    """How far a batch of one or several runs is.

    Args:
        n_frames: of all runs together; None = there is one run, which knows.
        console: where it is shown; None = standard error.
    """

    def __init__(self, n_frames: int | None = None, console: Console | None = None) -> None:
        self._n_frames, self._console = n_frames, console
        self._n_before = 0
        """Frames of the runs before this one."""
        self._is_warned = False

    @contextmanager
    def run(self, title: str) -> Iterator[Callable[[BatchStatus], None]]:
        """A run with the callback that it reports to."""
        status: BatchStatus | None = None

        def report(now: BatchStatus) -> None:
            nonlocal status
            status = now
            n_done, n_all = self._n_before + now.counts.frames_done, self._n_frames or now.n_frames
            pace = "writing tables" if n_done == n_all else _pace(bar.seconds_each)
            bar.show(title, n_done, n_all, _listed(pace, _recall(now), _red(_failed(now))))
            if now.doing:
                bar.say(now.doing)
            if now.warning and not self._is_warned:
                self._is_warned = True
                bar.say(f"note: {now.warning}")

        with ProgressBar(title, self._console) as bar:
            try:
                yield report
            except KeyboardInterrupt:
                n_done = self._n_before + (0 if status is None else status.counts.frames_done)
                if status is not None and n_done:
                    so_far = f"{title}: stopped after {n_done} of {self._n_frames or status.n_frames} frames"
                    bar.say(f"{_listed(so_far, _recall(status), _failed(status))}; the same command goes on")
                raise
        self._n_before += 0 if status is None else status.n_frames


def _pace(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds:.2f} s a frame"


def _recall(now: BatchStatus) -> str:
    return "" if now.counts.recall is None else f"recall {now.counts.recall:.0%}"


def _failed(now: BatchStatus) -> str:
    return f"{now.counts.frames_failed} failed" if now.counts.frames_failed else ""


def _red(words: str) -> str:
    return f"[red]{words}[/]" if words else ""


def _listed(*parts: str) -> str:
    return ", ".join(part for part in parts if part)
