"""What commands print: names from files are plain text."""

from __future__ import annotations

import io

import pytest
from rich.markup import escape
from rich.table import Table

from verefine_viz.batch.terminal import Terminal


@pytest.mark.parametrize("is_terminal", [True, False])
def test_codes_in_names_do_not_reach_the_terminal(is_terminal: bool) -> None:
    file = io.StringIO()
    console = Terminal(file=file, width=60, highlight=False, force_terminal=is_terminal)
    name = "a\x1b[31mb\x9b2J\u202ec\a\r\ud800"
    table = Table(title=escape(name))
    table.add_column(escape(name))
    table.add_row(escape(name))
    console.print(table)
    console.print(escape(f"note: {name}\nsecond line"))
    console.print(f"[bold]{escape(name)}[/]")
    text = file.getvalue()
    assert "\x1b[31m" not in text
    assert not {"\x9b", "\u202e", "\a", "\r", "\ud800"} & {*text}
    assert text.count("a�[31mb�2J") == 5
    assert ("\x1b[1m" in text) == is_terminal
    assert "\nsecond line\n" in text
