"""Write what columns, causes and their numbers mean into docs/tables.md and docs/causes.md (make tables)."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from verefine_viz.batch.fix_files import FixRow
from verefine_viz.core.causes import CAUSES, RERUN_NUMBERS, Cause
from verefine_viz.core.remedies import Remedy
from verefine_viz.run.answers import COLUMNS
from verefine_viz.run.record import Answer

DOCS = Path(__file__).resolve().parents[1] / "docs"
TABLES, CAUSES_PAGE = DOCS / "tables.md", DOCS / "causes.md"


def tables_page(page: str) -> str:
    """The text of docs/tables.md with the columns of frames.csv and fix.csv, and numbers of causes, as it has to be."""
    tables = {
        "frames.csv": _described(Answer, [column.name for column in COLUMNS]),
        "fix.csv": _described(FixRow, FixRow.__struct_fields__),
        "Evidence": _number_rows(),
    }
    for heading, rows in tables.items():
        page = _with_rows(page, heading, rows)
    return page


def _described(row: type, names: Sequence[str]) -> list[str]:
    texts = _docstrings(row)
    return [f"| `{name}` | {texts[name]} |" for name in names]


def _docstrings(row: type) -> dict[str, str]:
    """Docstrings of fields and properties of a struct, by name, as markdown in one line."""
    (defined,) = ast.parse(inspect.getsource(row)).body
    assert isinstance(defined, ast.ClassDef)
    texts: dict[str, str] = {}
    for at, behind in pairwise([*defined.body, ast.Pass()]):
        match at, behind:
            case ast.AnnAssign(ast.Name(name)), ast.Expr(ast.Constant(str(text))):
                texts[name] = text
            case ast.FunctionDef(name), _:
                texts[name] = ast.get_docstring(at) or ""
            case _:
                pass
    return {name: " ".join(text.replace("``", "`").split()) for name, text in texts.items()}


def _with_rows(page: str, heading: str, rows: list[str]) -> str:
    table = re.compile(rf"(\n## {re.escape(heading)}\n.*?\n\|[-|]+\|\n)(?:\|[^\n]*\n)*", re.DOTALL)
    return table.sub(lambda head: head[1] + "".join(f"{row}\n" for row in rows), page, count=1)


def _number_rows() -> list[str]:
    """Numbers that mean the same for several causes are one row."""
    causes: dict[tuple[str, str], list[Cause]] = {}
    for cause, known in CAUSES.items():
        for meaning in known.numbers.items():
            causes.setdefault(meaning, []).append(cause)
    rows = [(names, "any", text) for names, text in RERUN_NUMBERS.items()]
    rows += [(names, ", ".join(f"`{cause}`" for cause in of), text) for (names, text), of in causes.items()]
    return [f"| `{names.replace(', ', '`, `')}` | {of} | {text} |" for names, of, text in rows]


def causes_page(page: str) -> str:
    """The text of docs/causes.md with a section for each cause, as it is now, behind its introduction."""
    return page.partition("\n## ")[0] + "".join(_section(cause) for cause in CAUSES)


def _section(cause: Cause) -> str:
    known = CAUSES[cause]
    parts = [
        f"## {_capital(known.title)}",
        f"`{cause}`: {known.what}. Found {known.shown_by}.",
        f"{_capital(known.advice)}.{_tried(known.remedies)}",
        f"![{known.picture}](causes/{cause}.png)",
        *([f"`verefine-viz {known.command}`"] if known.command else []),
    ]
    return "\n" + "\n\n".join(parts) + "\n"


def _tried(remedies: Sequence[Remedy]) -> str:
    """Remedies as code; a multiple that only the finding knows with the name of its number."""
    names = (f"{one.setting} x ({one.times_number})" if one.times_number == "factor" else one.name for one in remedies)
    return f" `verefine-viz fix` tries {', '.join(f'`{name}`' for name in names)}." if remedies else ""


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def pages() -> Mapping[Path, str]:
    """What both pages have to be."""
    return {
        TABLES: tables_page(TABLES.read_text(encoding="utf-8")),
        CAUSES_PAGE: causes_page(CAUSES_PAGE.read_text(encoding="utf-8")),
    }


def main() -> None:
    """Write both pages; what is not generated in them stays."""
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
