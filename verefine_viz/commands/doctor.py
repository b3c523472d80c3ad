"""``verefine-viz doctor``: what this machine has, and whether it computes right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class DoctorCommand:
    """Check this machine: versions, OpenGL, physics, browser, viewer, write access, and a short self-check."""

    def run(self, arguments: Sequence[str]) -> int:
        from rich.markup import escape
        from rich.table import Table

        from verefine_viz.batch.terminal import Terminal
        from verefine_viz.commands import doctor_checks as checks

        console = Terminal(highlight=False)
        table = Table(title="verefine-viz doctor", show_lines=False)
        table.add_column("what", no_wrap=True)
        table.add_column("", no_wrap=True)
        table.add_column("result")
        with console.status("checking"):
            rows = [checks.run(check) for check in checks.all_checks()]
        for row in rows:
            mark = "[green]ok[/]" if row.ok else "[red]fails[/]" if row.needed else "[yellow]missing[/]"
            advice = "" if row.ok or not row.advice else f"\n→ {row.advice}"
            table.add_row(escape(row.name), mark, escape(row.result + advice))
        console.print(table)
        failed = [row.name for row in rows if row.needed and not row.ok]
        console.print(f"does not work: {', '.join(failed)}" if failed else "all that is needed is there")
        return 1 if failed else 0
