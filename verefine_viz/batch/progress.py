"""Progress on the terminal: how far a batch is, how fast, how long still, how good so far; bars of counted things."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from verefine_viz.batch.run_batch import Progress

EVERY_S = 30.0
"""Where there is no terminal (a log file), a line after so many seconds, also while a frame takes longer."""


@contextmanager
def shown_progress(title: str, console: Console) -> Iterator[Callable[[Progress], None]]:
    """A callback that shows progress: a bar on a terminal, lines in a log."""
    warned: set[str] = set()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[note]}"))
    latest, last_s, printed_at = f"{title}: starting", 0.0, monotonic()

    def print_latest() -> None:
        nonlocal printed_at
        printed_at = monotonic()
        console.print(escape(latest), soft_wrap=True)

    def keep_printing() -> None:
        while not is_over.wait(max(printed_at + EVERY_S - monotonic(), 0.01)):
            if monotonic() - printed_at >= EVERY_S:
                print_latest()

    is_over = threading.Event()
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        row = bar.add_task(escape(title), total=None, note="starting")

        def report(now: Progress) -> None:
            nonlocal latest, last_s
            bar.update(row, completed=now.counts.frames_done, total=now.n_frames, note=escape(in_words(now)))
            if now.doing:
                console.print(escape(now.doing), soft_wrap=True)
            if now.warning and not warned:
                warned.add(now.warning)
                console.print(escape(f"note: {now.warning}"), soft_wrap=True)
            latest = f"{title}: {now.counts.frames_done}/{now.n_frames} frames, {in_words(now)}"
            if not console.is_terminal and now.seconds - last_s > EVERY_S:
                last_s = now.seconds
                print_latest()

        if not console.is_terminal:
            threading.Thread(target=keep_printing, name="verefine-progress", daemon=True).start()
        try:
            yield report
        finally:
            is_over.set()


def in_words(now: Progress) -> str:
    """``2.3 frames/s, 3:12 left, recall 71 %, 2 failed``."""
    parts: list[str] = []
    n_left = now.n_frames - now.counts.frames_done
    if now.frame_s:
        parts.append(f"{1 / now.frame_s:.1f} frames/s" if now.frame_s <= 1 else f"{now.frame_s:.1f} s a frame")
        if n_left:
            parts.append(f"{clock(n_left * now.frame_s)} left")
    elif n_left:
        parts.append("starting")
    if now.counts.recall is not None:
        parts.append(f"recall {now.counts.recall:.0%}")
    if now.counts.frames_failed:
        parts.append(f"{now.counts.frames_failed} failed")
    return ", ".join(parts)


def clock(seconds: float) -> str:
    """``3:12``, or ``1:03:12``."""
    minutes, s = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{s:02d}" if hours else f"{minutes}:{s:02d}"


@contextmanager
def counted_bar(what: str) -> Iterator[Callable[[str, int, int], None]]:
    """A bar on stderr, if that is a terminal; the callback takes what is being done, how many are done, of how many."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    stderr = Console(stderr=True)
    with Bar(*columns, console=stderr, transient=True, disable=not stderr.is_terminal) as progress:
        bar = progress.add_task(escape(what), total=None)
        yield lambda what, done, total: progress.update(bar, description=escape(what), completed=done, total=total)
