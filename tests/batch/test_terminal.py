"""What commands print: names from files are plain text."""

from __future__ import annotations

import ast
import io
import logging
from pathlib import Path

import pytest
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from verefine_viz import cli
from verefine_viz.batch.terminal import Terminal
from verefine_viz.core.text_format import say

PACKAGE = Path(cli.__file__).parent


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
    console.print(Text(name))
    say(f"{name}\nsecond line", file)
    text = file.getvalue()
    assert "\x1b[31m" not in text
    assert not {"\x9b", "\u202e", "\a", "\r", "\ud800"} & {*text}
    assert text.count("a�[31mb�2J") == 7
    assert ("\x1b[1m" in text) == is_terminal
    assert "\nsecond line\n" in text


def test_a_warning_is_escaped_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert logging.lastResort is not None
    record = logging.LogRecord("a", logging.WARNING, "", 0, "the file %s", ("x\x1b[2J",), None)
    assert logging.lastResort.format(record) == "the file x�[2J"


def test_all_that_is_printed_goes_through_one_escape() -> None:
    """``say``, or a ``Terminal``: no other place prints, or makes a console."""
    found = set[tuple[str, str]]()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            if called in ("print", "Console", "sys.stdout.write", "sys.stderr.write"):
                found.add((str(path.relative_to(PACKAGE)), called))
            if isinstance(node, ast.ClassDef) and "Console" in map(ast.unparse, node.bases):
                found.add((str(path.relative_to(PACKAGE)), node.name))
    assert found == {("core/text_format.py", "print"), ("batch/terminal.py", "Terminal")}
