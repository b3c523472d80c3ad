"""How far a training is: a bar on a terminal, else a line from time to time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

EVERY_S = 30.0
"""Without a terminal, a line after so many seconds."""


@dataclass(frozen=True)
class TrainingProgress:
    """How far a training is."""

    step: int
    n_steps: int | None
    """None until the first steps are timed."""
    loss: float
    """Mean since the last report."""
    error: float
    """Mean of the error that is left; its unit is the training's."""
    minutes_left: float | None


@contextmanager
def shown_progress(
    console: Console, name: str, n_steps: int | None, describe: Callable[[TrainingProgress], str]
) -> Iterator[Callable[[TrainingProgress], None]]:
    """Shows what the function that it gives is called with.

    Args:
        console: where.
        name: of the network.
        n_steps: of the training, if it is known.
        describe: loss and error in words.
    """
    columns = TextColumn(name), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[note]}")
    printed_at = perf_counter()
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        row = bar.add_task(name, total=n_steps, note="drawing views")

        def report(now: TrainingProgress) -> None:
            nonlocal printed_at
            note = describe(now) + ("" if now.minutes_left is None else f", {now.minutes_left:.0f} min to go")
            bar.update(row, completed=now.step, total=now.n_steps, note=note)
            if not console.is_terminal and perf_counter() - printed_at > EVERY_S:
                printed_at = perf_counter()
                console.print(f"step {now.step} of {now.n_steps or '?'}, {note}")

        yield report
