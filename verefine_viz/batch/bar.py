"""A progress bar of things that are counted, on stderr and only where that is a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def counted_bar(what: str) -> Iterator[Callable[[str, int, int], None]]:
    """A bar that begins with ``what``; it is told what is being done, how many are done, and how many there are."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    stderr = Console(stderr=True)
    with Progress(*columns, console=stderr, transient=True, disable=not stderr.is_terminal) as progress:
        bar = progress.add_task(escape(what), total=None)
        yield lambda what, done, total: progress.update(bar, description=escape(what), completed=done, total=total)
