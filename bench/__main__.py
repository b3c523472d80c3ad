"""All benchmarks of this machine in one run: ``make bench`` or ``python -m bench [NAME …]``.

Each module of this folder that has a ``run()`` gives rows (dictionaries); they are printed as tables and written to
bench.json together with the machine and the versions.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from verefine_viz.batch.machine import machine
from verefine_viz.run.versions import package_versions

NAMES = ("score", "landscape", "physics", "icp", "methods", "scenes", "recording", "evaluation")
OUT = Path("bench.json")


def main(names: list[str]) -> int:
    """Runs the named benchmarks, all of them by default; the exit code."""
    unknown = sorted(set(names) - set(NAMES))
    if unknown:
        print(f"unknown benchmark {unknown[0]!r}; available: {', '.join(NAMES)}", file=sys.stderr)
        return 2
    console = Console(highlight=False)
    facts = machine()
    console.print(f"{facts['cpu']}, {facts['cores']} cores, Python {facts['python']}, {facts['system']}")
    results: dict[str, list[dict[str, Any]]] = {}
    for name in names or NAMES:
        started = time.perf_counter()
        with console.status(f"measuring {name}"):
            results[name] = importlib.import_module(f"bench.{name}").run()
        console.print(table(name, results[name], time.perf_counter() - started))
    part = OUT.with_name(OUT.name + ".part")
    made_by = {"machine": facts, "packages": package_versions()}
    part.write_text(json.dumps({**made_by, "results": results}, indent=2, ensure_ascii=False), encoding="utf-8")
    part.replace(OUT)
    console.print(f"written to {OUT}")
    return 0


def table(name: str, rows: list[dict[str, Any]], seconds: float) -> Table:
    """Rows of one benchmark."""
    shown = Table(title=f"{name} (measured in {seconds:.0f} s)", title_justify="left")
    columns = list(dict.fromkeys(column for row in rows for column in row))
    for column in columns:
        numeric = any(isinstance(row.get(column), int | float) for row in rows)
        shown.add_column(escape(column), justify="right" if numeric else "left")
    for row in rows:
        shown.add_row(*(escape(_shown(row.get(column))) for column in columns))
    return shown


def _shown(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
    return str(value)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
