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
from verefine_viz.core.writing import check_file

MOST_EMBEDDED, MOST_PICTURES = 200, 10_000
"""Largest numbers that are accepted: up to 600 MB of frames, and 80 MB of pictures."""


@dataclass(frozen=True)
class ReportCommand:
    """Write the report of a batch, of two side by side, or of many compared: one HTML file with scores, causes and all
    answers, that opens offline; the worst failures open in it.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN_DIR")]
    """The folder of a batch run, or of several (a sweep, several scenes): runs on the same data are compared, those
    that differ only in their seeds as one group; other data stand beside each other."""
    other: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[RUN_DIR_B]")] = None
    """Another run, to compare with: who got better, who got worse. Or another folder of runs."""
    out: Path | None = None
    """The file to write; by default report.html in RUN_DIR, for two of them report-against-NAME.html."""
    embed: int = 8
    """Frames with a wrong answer, without ground truth the most doubtful ones, that open in the file, the worst first,
    at most 200: 1 to 3 MB and a few seconds each. The others name the command that opens them. 0 = none."""
    beside: int = 0
    """Further frames with a wrong answer that get a file each, in a folder beside the report that the report opens, at
    most 200."""
    pictures: int = 300
    """Answers that have a picture, the worst first, at most 10000: about 8 kB each."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Threads for the BOP scores, no more than 4 per core; they are the same for any number."""

    def run(self, arguments: Sequence[str]) -> int:
        numbers = (
            ("embed", self.embed, MOST_EMBEDDED),
            ("beside", self.beside, MOST_EMBEDDED),
            ("pictures", self.pictures, MOST_PICTURES),
        )
        for flag, value, most in numbers:
            if not 0 <= value <= most:
                raise SettingsError(f"--{flag} is {quoted(value)}, expected 0 to {most}")
        check_workers(self.workers)
        if self.out is not None:
            check_file(self.out, "report.html")
        from verefine_viz.report.report_tools import report_tools
        from verefine_viz.report.write_report import print_report

        tools = report_tools(self.workers)
        print_report(self.folder, self.other, self.out, self.embed, self.beside, self.pictures, tools)
        return 0
