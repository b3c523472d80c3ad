"""``verefine-viz doctor``: what this machine has, and whether it computes right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from verefine_viz.core.text_format import say


@dataclass(frozen=True)
class DoctorCommand:
    """Check this machine: versions, OpenGL, physics, browser, viewer, write access, and a short self-check."""

    def run(self, arguments: Sequence[str]) -> int:
        from verefine_viz.commands import doctor_checks as checks
        from verefine_viz.core.console import Terminal, print_checks

        with Terminal().status("checking"):
            rows = [checks.run(check) for check in checks.all_checks()]
        print_checks("verefine-viz doctor", "what", [row.cells for row in rows])
        failed = [row.name for row in rows if row.needed and not row.ok]
        say(f"does not work: {', '.join(failed)}" if failed else "all that is needed is there")
        return 1 if failed else 0
