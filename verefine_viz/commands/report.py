"""``verefine-viz report``: one batch, two or many as one HTML file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from verefine_viz.commands.flags import check_workers
from verefine_viz.core.errors import SettingsError, quoted
from verefine_viz.core.paths import check_file

MOST_FAILURES = 10_000
"""The file holds their pictures: so many are a gigabyte."""


@dataclass(frozen=True)
class Report:
    """Write the report of a batch, of two side by side, or of many compared: one HTML file with scores, causes and
    failures.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN_DIR")]
    """The folder of a batch run, or of several (a sweep): runs that differ only in their seeds are one group, and the
    groups are compared."""
    other: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[RUN_DIR_B]")] = None
    """Another run of the same frames, to compare with: who got better, who got worse. Or another folder of runs."""
    out: Path | None = None
    """The file to write; by default report.html in RUN_DIR, for two of them report-against-NAME.html."""
    failures: int = 60
    """Failures that are shown with pictures, worst first, as many of each group, at most 10000; 0 = none."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Threads for the BOP scores, no more than 4 per core; they are the same for any number."""

    def run(self, arguments: Sequence[str]) -> int:
        if not 0 <= self.failures <= MOST_FAILURES:
            raise SettingsError(f"--failures is {quoted(self.failures)}, expected 0 to {MOST_FAILURES}")
        check_workers(self.workers)
        if self.out is not None:
            check_file(self.out, "report.html")
        from verefine_viz.report.build_report import print_report

        print_report(self.folder, self.other, self.out, self.failures, self.workers)
        return 0
