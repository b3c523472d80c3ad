"""What commands print: names from files are plain text, numbers are never cut, and a bar is a bar only on terminals."""

from __future__ import annotations

import ast
import io
import logging
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.markup import escape
from rich.text import Text

from verefine_viz import cli
from verefine_viz.core import console
from verefine_viz.core.console import PrintedTable, ProgressBar, Terminal, print_table
from verefine_viz.core.text_format import say

PACKAGE = Path(cli.__file__).parent
NAME = "a\x1b[31mb\x9b2J\u202ec\a\r\ud800"
"""With codes for a terminal, from a file."""


@pytest.mark.parametrize("is_terminal", [True, False])
def test_codes_in_names_do_not_reach_the_terminal(is_terminal: bool, capsys: pytest.CaptureFixture[str]) -> None:
    file = io.StringIO()
    terminal = Terminal(file=file, width=60, force_terminal=is_terminal)
    terminal.print(escape(f"note: {NAME}\nsecond line"))
    terminal.print(f"[bold]{escape(NAME)}[/]")
    terminal.print(Text(NAME))
    with ProgressBar(NAME, terminal) as bar:
        bar.show(NAME, 1, 2)
        bar.say(NAME)
    say(f"{NAME}\nsecond line", file)
    print_table(PrintedTable(NAME, (NAME,), ((NAME,),), note=NAME))
    text = file.getvalue() + capsys.readouterr().out
    assert "\x1b[31m" not in text
    assert not {"\x9b", "\u202e", "\a", "\ud800"} & {*text}
    assert text.count("a�[31mb�2J") >= 9
    assert ("\x1b[1m" in text) == is_terminal
    assert "\nsecond line\n" in text


def test_a_warning_is_escaped_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert logging.lastResort is not None
    record = logging.LogRecord("a", logging.WARNING, "", 0, "the file %s", ("x\x1b[2J",), None)
    assert logging.lastResort.format(record) == "the file x�[2J"


def test_all_that_is_printed_goes_through_one_escape() -> None:
    """``say``, or a ``Terminal``: no other place prints, or makes a console or a table."""
    found = set[tuple[str, str]]()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            if called in ("print", "Console", "Table", "sys.stdout.write", "sys.stderr.write"):
                found.add((str(path.relative_to(PACKAGE)), called))
            if isinstance(node, ast.ClassDef) and "Console" in map(ast.unparse, node.bases):
                found.add((str(path.relative_to(PACKAGE)), node.name))
    assert found == {("core/text_format.py", "print"), ("core/console.py", "Terminal"), ("core/console.py", "Table")}


WORDS = st.text("ab-_ ", max_size=60).map(str.strip)
NUMBERS = st.from_regex(r"[0-9]{1,9}( \([0-9]{2}\))?", fullmatch=True)


@given(rows=st.lists(st.tuples(WORDS, WORDS, NUMBERS, NUMBERS), min_size=1, max_size=4), columns=st.integers(20, 150))
def test_numbers_are_never_cut_and_words_are_folded(rows: list[tuple[str, ...]], columns: int) -> None:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("COLUMNS", str(columns))
        patched.setattr(console, "FILE_COLUMNS", 0)
        patched.setattr("sys.stdout", said := io.StringIO())
        print_table(PrintedTable("", ("one", "two", "a number", "another"), tuple(rows), n_words=2))
    lines, text = said.getvalue().splitlines(), said.getvalue()
    assert "…" not in text
    for row in rows:
        assert any(re.search(rf"{re.escape(row[2])} +{re.escape(row[3])} *$", line) for line in lines)
    assert sum(map(text.count, "ab-_")) == sum(map("".join(map("".join, rows)).count, "ab-_")) + len("a a")
    # As narrow as may be: two columns of words, the numbers, what is between.
    least = sum(min(12, max(map(len, ("one", *(row[k] for row in rows))))) for k in (0, 1)) + 19 + 19 + 12
    assert max(map(len, lines)) <= max(columns, least)


def bar_on_terminal(width: int) -> str:
    text = io.StringIO()
    terminal = Terminal(file=text, width=width, force_terminal=True, color_system="standard", legacy_windows=False)
    with ProgressBar("run 12 of 100: a-long-name-of-a-method-17", terminal) as bar:
        bar.show("run 12 of 100: a-long-name-of-a-method-17", 7, 300, "1.20 s a frame, recall 100%, [red]2 failed[/]")
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text.getvalue()).replace("\r", "\n")


@pytest.mark.parametrize("width", [80, 130])
def test_the_bar_leaves_room_for_a_typed_ctrl_c(width: int) -> None:
    bars = [line for line in bar_on_terminal(width).splitlines() if "━" in line]
    assert max(map(len, bars)) <= width - 3
    assert bars[-1].startswith("run 12 of 100: ")
    assert re.search(r"━ +7/300 +-+:-- +1.20 s a frame, recall 100%, 2 failed *$", bars[-1])


def test_a_log_gets_a_line_now_and_then_where_there_is_news(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    text = io.StringIO()
    monkeypatch.setattr(console, "monotonic", lambda: now)
    with ProgressBar("study", Terminal(file=text)) as bar:
        bar._bar.get_time = lambda: now
        for done in (40, *range(41, 51), 50, 50):  # 40 were done before
            bar.show("study", done, 60)
            now += 3.0
        now += 30.0
        bar.show("figures", 0, 4)
        bar.show("figures", 1, 4)
        assert bar.seconds_each is None
    assert text.getvalue().splitlines() == ["study, 47/60, 0:00:39 left", "figures, 0/4"]
