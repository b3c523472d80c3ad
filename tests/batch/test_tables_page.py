"""docs/tables.md and docs/causes.md say what every column, cause, number of evidence and event means."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

from verefine_viz.core.records import EventKind
from verefine_viz.diagnosis.causes import ADVICE, TITLES, Cause
from verefine_viz.run.answers import COLUMNS
from verefine_viz.run.built_in_sessions import built_in_sessions
from verefine_viz.run.record import Status

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "tables.md").read_text("utf-8")
CAUSES = (ROOT / "docs" / "causes.md").read_text("utf-8")


def rows_of(heading: str) -> dict[str, list[str]]:
    """The table below a heading: its rows by the name in their first cell."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [re.split(r"\s*\|\s*", line.strip("| ")) for line in section.splitlines() if line.startswith("| `")]
    return {cells[0].strip("`"): cells[1:] for cells in lines}


def test_the_page_has_the_columns_of_the_table_and_what_they_say() -> None:
    """Where this fails: ``make tables``."""
    section = PAGE.split("\n## frames.csv\n")[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| `")]
    assert lines == [f"| `{column.name}` | {column.text} |" for column in COLUMNS]


def test_every_status_is_defined() -> None:
    (said,) = rows_of("frames.csv")["status"]
    for status in get_args(Status):
        assert f"`{status}`: " in said


def test_every_cause_is_defined_under_its_title_with_what_to_try() -> None:
    sections = re.findall(r"^## (.+)\n\n`(\w+)`: .+\n\n(.+)\.\n", CAUSES, re.MULTILINE)
    said = [(title[0].lower() + title[1:], name, advice[0].lower() + advice[1:]) for title, name, advice in sections]
    assert said == [(TITLES[cause], cause.value, ADVICE[cause]) for cause in Cause]


def test_every_cause_has_a_picture_and_every_failure_session_one() -> None:
    shown = re.findall(r"!\[.+\]\(causes/\w+\.png\)\n\n`verefine-viz view (\w+)`", CAUSES)
    assert {*shown} == {n for n in built_in_sessions() if n.startswith("failure_")}
    pictures = re.findall(r"!\[.+\]\(causes/(\w+)\.png\)", CAUSES)
    assert pictures == [cause.value for cause in Cause]
    assert all((ROOT / "docs" / "causes" / f"{name}.png").is_file() for name in pictures)


def numbers_of_evidence() -> set[str]:
    """The names in the table."""
    names = {name for cell in rows_of("Evidence") for name in re.findall(r"\w+", cell)}
    assert len(names) > 50
    return names


def plain(name: str) -> str:
    """Without what the page explains for all names."""
    return name.removeprefix("scene_").removesuffix("_of_ground_truth") if name != ERROR_OF_DRIFT else name


ERROR_OF_DRIFT = "error_of_simulated_ground_truth"


def keys_of_evidence(path: Path) -> Iterator[str]:
    """Of all that a file of the diagnosis puts into evidence, as regular expressions where names are put together."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Finding":
            places: list[ast.AST] = [node.args[2]]
        elif isinstance(node, ast.Assign | ast.AugAssign):
            to = node.targets[0] if isinstance(node, ast.Assign) else node.target
            at = to.value if isinstance(to, ast.Subscript) else to
            is_it = isinstance(at, ast.Name) and at.id in ("evidence", "numbers")
            places = (
                [node.value, *([ast.Dict([to.slice], [])] if isinstance(to, ast.Subscript) else [])] if is_it else []
            )
        else:
            places = []
        for part in (part for place in places for part in ast.walk(place)):
            if isinstance(part, ast.Dict | ast.DictComp):
                for key in part.keys if isinstance(part, ast.Dict) else [part.key]:
                    if isinstance(key, ast.Constant):
                        yield str(key.value)
                    elif isinstance(key, ast.JoinedStr):
                        yield "".join(str(v.value) if isinstance(v, ast.Constant) else r"\w*" for v in key.values)


def test_every_number_of_evidence_is_defined_and_nothing_else() -> None:
    named, made = numbers_of_evidence(), set()
    for path in sorted((ROOT / "verefine_viz" / "diagnosis").glob("*.py")):
        for pattern in keys_of_evidence(path):
            meant = {name for name in named if re.fullmatch(plain(pattern), name) or re.fullmatch(pattern, name)}
            assert meant, f"{path.name}: {pattern} is not in docs/tables.md"
            made |= meant
    assert made == named


def test_every_event_is_defined() -> None:
    assert set(rows_of("Events")) == set(get_args(EventKind))
