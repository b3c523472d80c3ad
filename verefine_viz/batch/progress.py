"""Progress on the terminal: how far a batch is, how fast, how long still, how good so far; bars of counted things."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn
from rich.progress import Progress as Bar
from rich.table import Column
from rich.text import Text

from verefine_viz.batch.pace import Pace
from verefine_viz.batch.terminal import Terminal
from verefine_viz.run.kernel_compilation import COMPILING

if TYPE_CHECKING:
    from verefine_viz.batch.run_batch import BatchStatus

EVERY_S = 20.0
"""Where there is no terminal (a log file), a line after so many seconds."""
WELL, FAILING = "green", "red"
"""Colours of a bar."""
TITLE_SHARE = 1 / 4
"""Most of a line that its title gets; the bar gets what is left."""


class BatchProgress:
    """How far a batch of one or several runs is: a bar on a terminal, lines in a log.

    Args:
        console: where it is shown.
        n_frames: of all runs together; None = there is one run, which knows.
    """

    def __init__(self, console: Console, n_frames: int | None = None) -> None:
        self.pace = Pace()
        self._console, self._n_frames = console, n_frames
        self._title = ""
        self._now: BatchStatus | None = None
        self._n_before = 0
        """Frames of the runs before this one."""
        self._warned: set[str] = set()

    @contextmanager
    def run(self, title: str) -> Iterator[Callable[[BatchStatus], None]]:
        """A run with the callback that it reports to."""
        self._title, self._now = title, None
        colour = _bar()
        live = _Words(self._rate, 14), _Words(self._left, 9), _Words(self._recall, 11), _Words(self._failed, 0, FAILING)
        with _live(self._console, (*_counted(self._console, colour), *live)) as bar:
            row = bar.add_task(escape(title), total=self._n_frames, completed=self._n_before)

            def report(now: BatchStatus) -> None:
                self._now = now
                if now.counts.frames_failed:
                    colour.complete_style = colour.finished_style = FAILING
                bar.update(row, completed=self._n_done, total=self._total)
                if now.doing:
                    self._print(now.doing)
                if now.warning and not self._warned:
                    self._warned.add(now.warning)
                    self._print(f"note: {now.warning}")

            try:
                yield report
            except KeyboardInterrupt:
                bar.stop()
                if self._n_done:
                    so_far = f"{self._title}: stopped after {self._n_done} of {self._total} frames"
                    parts = ", ".join(part for part in (so_far, self._recall(), self._failed()) if part)
                    self._print(f"{parts}; the same command goes on")
                raise
        self._n_before += 0 if self._now is None else self._now.n_frames

    @contextmanager
    def shown(self) -> Iterator[BatchProgress]:
        """All runs."""
        with _printed_now_and_then(self._console, self.describe):
            yield self

    @property
    def _n_done(self) -> int:
        return self._n_before + (0 if self._now is None else self._now.counts.frames_done)

    @property
    def _total(self) -> int | None:
        return self._n_frames or (None if self._now is None else self._now.n_frames)

    def _rate(self) -> str:
        frame_s = self.pace.frame_s
        if frame_s is None and self._n_done == self._total:
            return ""
        return self._once() or "starting" if frame_s is None else f"{two_digits(frame_s)} s a frame"

    def _once(self) -> str:
        """Say what is being done that later frames need not repeat; "" for nothing."""
        once = self.pace.once
        return "" if not once else "compiling" if COMPILING in once else "preparing"

    def _left(self) -> str:
        n_left = (self._total or 0) - self._n_done
        if self._total and not n_left:
            return "writing tables"
        left_s = self.pace.left_s(n_left, monotonic())
        if left_s is None:
            return ""
        once = self._once()
        return f"{clock(max(left_s, 1.0))} left{f' + {once}' if once else ''}"

    def _recall(self) -> str:
        recall = None if self._now is None else self._now.counts.recall
        return "" if recall is None else f"recall {recall:.0%}"

    def _failed(self) -> str:
        n = 0 if self._now is None else self._now.counts.frames_failed
        return f"{n} failed" if n else ""

    def describe(self) -> str:
        """``run 2 of 10: rir-1, 12/30 frames, 1.2 s a frame, 0:22 left, recall 71%, 2 failed``."""
        frames = f"{self._n_done}/{'?' if self._total is None else self._total} frames"
        parts = (self._title, frames, self._rate(), self._left(), self._recall(), self._failed())
        return ", ".join(part for part in parts if part)

    def _print(self, words: str) -> None:
        self._console.print(escape(words), soft_wrap=True, highlight=False)


@contextmanager
def counted_bar(what: str) -> Iterator[Callable[[str, int, int], None]]:
    """A bar on stderr, in a log a line now and then; the callback takes what is being done, how many are done, of how
    many.
    """
    console, pace, n_done, n_all = Terminal(stderr=True), Pace(), 0, 0

    def left() -> str:
        left_s = pace.left_s(n_all - n_done, monotonic())
        return "" if left_s is None or n_done == n_all else f"{clock(max(left_s, 1.0))} left"

    def describe() -> str:
        return ", ".join(
            part for part in (f"{what}: {n_done}/{n_all}" if n_all else f"{what}: starting", left()) if part
        )

    with _printed_now_and_then(console, describe), _live(console, (*_counted(console, _bar()), _Words(left, 9))) as bar:
        row = bar.add_task(escape(what), total=None)

        def report(now: str, done: int, total: int) -> None:
            nonlocal what, pace, n_done, n_all
            if now != what or done < n_done or not n_all:
                # Those that are done when it begins were done before.
                what, pace, n_done = now, Pace(), done
                pace.begin("", monotonic())
            for _ in range(done - n_done):
                pace.end("", monotonic())
                pace.begin("", monotonic())
            n_done, n_all = done, total
            bar.update(row, description=escape(what), completed=done, total=total)

        yield report


def clock(seconds: float) -> str:
    """``3:12``, or ``1:03:12``."""
    minutes, s = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{s:02d}" if hours else f"{minutes}:{s:02d}"


def two_digits(seconds: float) -> str:
    """``0.012``, ``0.25``, ``1.2``, ``12``, ``125``: in one unit, whatever the size."""
    digits = 1 - math.floor(math.log10(seconds)) if seconds > 0 else 0
    return f"{seconds:.{min(max(digits, 0), 3)}f}"


class _Words(ProgressColumn):
    """What a function returns at each refresh, also between two reports."""

    def __init__(self, words: Callable[[], str], width: int, style: str = "") -> None:
        super().__init__(Column(no_wrap=True, min_width=width))
        self._words, self._style = words, style

    def render(self, task: Task) -> Text:
        return Text(self._words(), style=self._style)


class _Bar(Bar):
    """Leaves the end of the line free: a ^C that is typed there would begin a line that is not erased with the bar."""

    def get_renderables(self) -> Iterator[RenderableType]:
        yield _Narrower(self.make_tasks_table(self.tasks))


@dataclass(frozen=True)
class _Narrower:
    inner: RenderableType

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield from console.render(self.inner, options.update(width=options.max_width - 3))


def _bar() -> BarColumn:
    return BarColumn(None, complete_style=WELL, finished_style=WELL, pulse_style=WELL)


def _counted(console: Console, bar: BarColumn) -> tuple[ProgressColumn, ...]:
    title = Column(no_wrap=True, overflow="ellipsis", max_width=int(console.width * TITLE_SHARE))
    return (
        TextColumn("{task.description}", table_column=title),
        bar,
        MofNCompleteColumn(table_column=Column(no_wrap=True)),
    )


def _live(console: Console, columns: tuple[ProgressColumn, ...]) -> Bar:
    return _Bar(
        *columns, console=console, transient=True, expand=True, disable=not console.is_terminal, redirect_stdout=False
    )


@contextmanager
def _printed_now_and_then(console: Console, describe: Callable[[], str]) -> Iterator[None]:
    """Where ``console`` is no terminal, a line every :data:`EVERY_S` that says something new."""
    if console.is_terminal:
        yield
        return
    is_over = threading.Event()

    def keep_printing() -> None:
        said = ""
        while not is_over.wait(EVERY_S):
            if (now := describe()) != said:
                console.print(escape(now), soft_wrap=True, highlight=False)
            said = now

    thread = threading.Thread(target=keep_printing, name="verefine-progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
