"""Every statement of docs/paper.md names what there is: files, names in them, tests, commands."""

from __future__ import annotations

import ast
import re
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
SECTIONS = ["I", "II", "III", "III-A", "III-B", "III-C", "IV", "IV-A", "IV-B", "IV-C"]
SECTIONS += ["V", "V-A", "V-B", "V-C", "V-D", "VI"]
NUMBERED = {"Eq. 1", "Eq. 2", "Fig. 3", "Fig. 4", "Fig. 5", "Table I", "Table II", "Table III", "Table IV"}
"""Equations, tables, and figures that show a method or numbers."""


@dataclass(frozen=True)
class Statement:
    """A row."""

    section: str
    """With the equation, figure or table after a comma."""
    text: str
    code: str
    shown: str
    here: str

    @property
    def paths(self) -> list[Path]:
        """Files of the second column, in the package or in the repository."""
        named = re.findall(r"`([\w./]+/[\w./]+)`", self.code)
        return [next(p for p in (ROOT / "verefine_viz" / one, ROOT / one) if p.exists()) for one in named]


def statements() -> list[Statement]:
    cells = [[c.strip() for c in re.split(r"(?<!\\)\|", line)[1:-1]] for line in PAGE.splitlines() if line[:1] == "|"]
    return [Statement(*row) for row in cells if re.fullmatch(r"[IV]+(-[A-D])?(, .+)?", row[0]) and len(row) == 5]


@cache
def names_in(path: Path) -> frozenset[str]:
    """What a file defines, members as "Class.member"."""
    if path.suffix != ".py":
        return frozenset()
    names: set[str] = set()

    def add(body: list[ast.stmt], before: str) -> None:
        for node in body:
            match node:
                case ast.FunctionDef(name=name):
                    names.add(before + name)
                case ast.ClassDef(name=name, body=members):
                    names.add(before + name)
                    add(members, f"{before}{name}.")
                case ast.AnnAssign(target=ast.Name(id=name)):
                    names.add(before + name)
                case ast.Assign(targets=targets):
                    names.update(before + n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name))
                case _:
                    pass

    add(ast.parse(path.read_text(encoding="utf-8")).body, "")
    return frozenset(names)


def test_each_section_equation_and_table_of_the_paper_has_statements() -> None:
    assert len(statements()) > 100
    parts = [part for s in statements() for part in s.section.split(", ")]
    assert set(SECTIONS) == {part for part in parts if part in SECTIONS}
    # "Tables I to III" stands for three.
    assert {part for part in parts if part not in SECTIONS and not part.startswith("Tables ")} == NUMBERED
    firsts = [SECTIONS.index(s.section.split(", ")[0]) for s in statements()]
    assert firsts == sorted(firsts), "in the paper's order"


def test_what_a_statement_names_in_the_code_is_there() -> None:
    missing: list[tuple[str, str]] = []
    for s in statements():
        assert s.paths, s.text
        known = frozenset[str]().union(*map(names_in, s.paths))
        missing += [(s.text, name) for name in re.findall(r"`([\w.]+)`", s.code) if name not in known]
    assert missing == []


def test_what_shows_a_statement_is_there() -> None:
    for s in statements():
        files = [ROOT / path for path in re.findall(r"`(tests/[\w/]+\.py)`", s.shown)]
        known = frozenset[str]().union(*map(names_in, files))
        assert [name for name in re.findall(r"`(test_\w+)`", s.shown) if name not in known] == [], s.text
        # Commands and links are checked with those of all documents.
        is_shown = files or "`verefine-viz " in s.shown or "`python -m bench" in s.shown or "](" in s.shown
        assert is_shown or s.here.startswith("**open**"), s.text


def test_the_sections_of_methods_exist() -> None:
    methods = (ROOT / "docs" / "methods.md").read_text(encoding="utf-8")
    headings = set(re.findall(r"^#+ ([\d.]+) ", methods, re.MULTILINE))
    named = re.findall(r"§(\d+(?:\.\d+)*)", PAGE)
    assert len(named) > 30
    assert [number for number in named if number not in headings] == []


def test_the_rows_are_counted() -> None:
    marks = Counter(re.findall(r"^\*\*([\w-]+)\*\*", "\n".join(s.here for s in statements()), re.MULTILINE))
    assert sum(marks.values()) == len(statements())
    written = re.findall(r"^\| \*\*([\w-]+)\*\* \|.*\| (\d+) \|$", PAGE, re.MULTILINE)
    assert {mark: int(n) for mark, n in written} == marks
