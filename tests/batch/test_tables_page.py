"""The documents say what every column, cause, number of evidence and event means."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import get_args

from scripts.cause_scenes import SCENES
from scripts.write_tables import pages
from verefine_viz.core.causes import CAUSES, RERUN_NUMBERS, Cause
from verefine_viz.core.records import EventKind
from verefine_viz.run.built_in_sessions import built_in_sessions
from verefine_viz.run.record import Status

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "tables.md").read_text("utf-8")


def rows_of(heading: str) -> dict[str, list[str]]:
    """The table below a heading: its rows by the name in their first cell."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [re.split(r"\s*\|\s*", line.strip("| ")) for line in section.splitlines() if line.startswith("| `")]
    return {cells[0].strip("`"): cells[1:] for cells in lines}


def test_what_is_written_of_columns_causes_and_numbers_is_what_they_are() -> None:
    """Where this fails: ``make tables``."""
    for path, text in pages().items():
        assert path.read_text("utf-8") == text, path.name


def test_every_status_is_defined() -> None:
    (said,) = rows_of("frames.csv")["status"]
    for status in get_args(Status):
        assert f"`{status}`: " in said


def test_every_cause_has_a_record_a_picture_and_a_frame_that_shows_it() -> None:
    assert list(CAUSES) == list(Cause)
    sessions = {known.command.removeprefix("view ") for known in CAUSES.values()} - {""}
    assert {n for n in built_in_sessions() if n.startswith("failure_")} == {n for n in sessions if "--" not in n}
    for cause, known in CAUSES.items():
        assert (ROOT / "docs" / "causes" / f"{cause}.png").is_file(), cause
        assert (cause in SCENES) != bool(known.command), cause


def names_of(numbers: Mapping[str, str]) -> set[str]:
    """All names in the numbers of a cause."""
    return {name for names in numbers for name in names.split(", ")}


def plain(name: str) -> str:
    """Without what the page explains for all names."""
    return name.removeprefix("scene_").removesuffix("_of_ground_truth") if name != ERROR_OF_DRIFT else name


ERROR_OF_DRIFT = "error_of_simulated_ground_truth"


def keys_of_evidence(path: Path) -> Iterator[str]:
    """Of all that a file of the diagnosis puts into evidence, as regular expressions where names are put together."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Finding":
            places: list[ast.AST] = [*node.args[2:3]]  # One without evidence stands for no finding.
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
    named = names_of(RERUN_NUMBERS).union(*(names_of(known.numbers) for known in CAUSES.values()))
    made = set()
    for path in sorted((ROOT / "verefine_viz" / "diagnosis").glob("*.py")):
        if path.name == "data_doubts.py":  # Its numbers are those of doubts about data, not of causes.
            continue
        for pattern in keys_of_evidence(path):
            meant = {name for name in named if re.fullmatch(plain(pattern), name) or re.fullmatch(pattern, name)}
            assert meant, f"{path.name}: {pattern} is in the numbers of no cause"
            made |= meant
    assert made == named


def test_every_event_is_defined() -> None:
    assert set(rows_of("Events")) == set(get_args(EventKind))
