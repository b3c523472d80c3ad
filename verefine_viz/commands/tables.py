"""Tables in a terminal: narrow, and numbers are never cut."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

SHORTEST = 12
"""What stays of a name at least [characters]."""


def narrow_table(names: Sequence[str], numbers: Sequence[str]) -> Table:
    """A table without lines: ``names`` are the columns of texts, ``numbers`` those behind them."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in names:
        table.add_column(name, overflow="ellipsis", no_wrap=True)
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def print_whole(title: str, table: Table, cut: str) -> None:
    """Prints a table whose column ``cut`` gives way where the terminal is too narrow; others stay whole.

    Where even that is not enough, lines are longer than the terminal is wide.
    """
    console = Console(highlight=False)
    console.print(f"[italic]{escape(title)}[/]", soft_wrap=True)
    too_wide = _width(console, table) - console.width
    if too_wide > 0:
        column = next(c for c in table.columns if c.header == cut)
        longest = max(cell_len(str(cell)) for cell in (column.header, *column.cells))
        column.max_width = max(longest - too_wide, min(longest, SHORTEST))
    Console(highlight=False, width=max(console.width, _width(console, table))).print(table)


def _width(console: Console, table: Table) -> int:
    """How wide a table is if nothing is cut."""
    return Measurement.get(console, console.options.update(max_width=10_000), table).maximum
