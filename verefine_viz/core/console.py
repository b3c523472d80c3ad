"""Output of all commands to the terminal: texts without control characters, a progress bar, tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from time import monotonic
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, RenderableType
from rich.markup import escape
from rich.measure import Measurement
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from verefine_viz.core.text_format import plain

EVERY_S = 20.0
"""Time between lines of progress in a log file, where there is no terminal [s]."""
SPEED_S = 3600.0
"""Period from which the time left is computed [s]: a step may take minutes."""
TITLE_SHARE = 1 / 4
"""Largest share of a line for the bar's title."""
COLOUR = "green"
"""Colour of the bar; rich's own is as red as a failure."""
CTRL_C = 3
"""Columns that the bar leaves free: a typed ^C would begin a line that is not erased with the bar."""
FILE_COLUMNS = 200
"""Width of a table that is printed into a file, where it needs so much."""
LEAST_WORDS, MOST_WORDS = 12, 28
"""Least width of a column of words; it is as wide as its longest word, up to the second number of characters."""
MARKS = {"ok": "green", "look": "yellow", "missing": "yellow", "fails": "red"}
"""Colours of the results of a check."""


class Terminal(Console):
    """A console on which names and notes that come from files are plain text, without control characters.

    Lines are as long as their text is.
    """

    def __init__(self, stderr: bool = False, **options: Any) -> None:
        super().__init__(stderr=stderr, highlight=False, soft_wrap=True, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """As its base; colours come from its markup, never from codes in the text."""
        return super().render_str(plain(text), **options)

    def render(self, renderable: Any, options: Any = None) -> Iterable[Segment]:
        """As its base, also of texts that were made elsewhere."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(plain(segment.text), segment.style)


class ProgressBar:
    """How many things are done, and how long the others take: a bar on a terminal, which goes away at the end; in a
    log a line now and then.

    Args:
        title: what is being done.
        console: where; None = standard error.
    """

    def __init__(self, title: str, console: Console | None = None) -> None:
        self._console = Terminal(stderr=True) if console is None else console
        most = int(self._console.width * TITLE_SHARE)
        uncut = Column(no_wrap=True)
        self._bar = _Bar(
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, max_width=most)),
            BarColumn(None, complete_style=COLOUR, finished_style=COLOUR, pulse_style=COLOUR),
            MofNCompleteColumn(table_column=uncut),
            TimeRemainingColumn(compact=True, table_column=uncut),
            TextColumn("{task.fields[note]}", table_column=uncut),
            console=self._console,
            transient=True,
            expand=True,
            disable=not self._console.is_terminal,
            redirect_stdout=False,
            speed_estimate_period=SPEED_S,
        )
        self._bar.add_task(title, total=None, note="")
        (self._task,) = self._bar.tasks
        self._printed, self._printed_at = "", monotonic()

    def __enter__(self) -> ProgressBar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def show(self, what: str, done: int, total: int | None, note: str = "") -> None:
        """Show how far it is. The time left is that of what is being done now, without what was done when it began.

        Args:
            what: what is being done.
            done: how many things.
            total: of how many; None = unknown.
            note: what else there is to see, in rich's markup.
        """
        if what != self._task.description or done < self._task.completed:
            self._bar.reset(self._task.id, description=what)
        self._bar.update(self._task.id, completed=done, total=total, note=note)
        if not self._console.is_terminal and monotonic() - self._printed_at > EVERY_S and self._line != self._printed:
            self._printed, self._printed_at = self._line, monotonic()
            self._console.print(self._line, soft_wrap=True, highlight=False)

    def say(self, text: str) -> None:
        """Print a line above the bar, which stays."""
        self._console.print(escape(text), soft_wrap=True, highlight=False)

    @property
    def seconds_each(self) -> float | None:
        """Mean time between two that are done; None = unknown."""
        return 1 / self._task.speed if self._task.speed else None

    @property
    def _line(self) -> str:
        """``run 2 of 10: rir-1, 12/30, 0:00:22 left, 1.20 s a frame, recall 71%``."""
        task = self._task
        of = "?" if task.total is None else f"{task.total:.0f}"
        left = f"{timedelta(seconds=task.time_remaining)} left" if task.time_remaining else ""
        parts = escape(task.description), f"{task.completed:.0f}/{of}", left, task.fields["note"]
        return ", ".join(part for part in parts if part)


class _Bar(Progress):
    def get_renderables(self) -> Iterable[RenderableType]:
        if self.tasks:  # Rich asks before it has its console, too.
            table = self.make_tasks_table(self.tasks)
            table.width = self.console.width - CTRL_C
            yield table


@dataclass(frozen=True)
class PrintedTable:
    """A table to print, row by row; the first columns hold words."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    styles: Mapping[tuple[int, int], str] = field(default_factory=dict)
    """Styles of rich, such as "bold" or "red", by row and column."""
    rules: tuple[int, ...] = ()
    """Rows above which there is a rule."""
    note: str = ""
    """Explanation of the numbers, printed below the table."""
    n_words: int = 1
    """Columns of words, which take several lines where one is too short; the others hold numbers."""


def print_table(printed: PrintedTable) -> None:
    """Print a table on standard output. Numbers are never cut: lines are longer than a terminal that is too narrow."""
    console = Terminal()
    if printed.title:
        console.print(Text(printed.title, "italic"))
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for k, heading in enumerate(printed.headings):
        cells = [heading, *(row[k] for row in printed.rows)]
        widest = max(cell_len(line) for cell in cells for line in cell.split("\n"))
        if k < printed.n_words:
            longest = max((cell_len(word) for cell in cells for word in cell.split()), default=0)
            least = min(max(longest, LEAST_WORDS), MOST_WORDS, widest)
            table.add_column(Text(heading), overflow="fold", min_width=least, max_width=least)
        else:
            table.add_column(Text(heading), justify="right", no_wrap=True, min_width=widest)
    for r, row in enumerate(printed.rows):
        cells = (Text(cell, printed.styles.get((r, k), "")) for k, cell in enumerate(row))
        table.add_row(*cells, end_section=r + 1 in printed.rules)
    width = Measurement.get(console, console.options.update(max_width=10_000), table).maximum
    for column in table.columns:
        column.max_width = None
    console.width = max(console.width if console.is_terminal else FILE_COLUMNS, width)
    console.print(table)
    if printed.note:
        console.print(Text(printed.note, "dim"))


def print_checks(title: str, what: str, rows: Sequence[tuple[str, str, str]]) -> None:
    """Print what was checked (its heading is ``what``), whether it is well, a word of :data:`MARKS`, and the result."""
    styles = {(k, 1): MARKS.get(mark, "") for k, (_, mark, _) in enumerate(rows)}
    print_table(PrintedTable(title, (what, "", "result"), tuple(rows), styles, n_words=3))
