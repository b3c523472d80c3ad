"""``verefine-viz study``: the paper's ablation, robustness, tables and grasping on any data."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from verefine_viz.commands.flags import AnySettings, SessionFlags, check_seeds, check_workers, given
from verefine_viz.core.writing import check_folder


@dataclass(frozen=True)
class StudyCommand:
    """Run a study of the paper with its budgets: every method under growing error, with missing depth, or as it is.

    Methods, calls and initial poses are the study's, whatever the session has; as options they are refused.
    """

    name: Annotated[Literal["ablation", "robustness", "tables", "grasping"], tyro.conf.Positional]
    """ablation: error of the initial pose (Fig. 4). robustness: missing depth (Fig. 5). tables: DF-R, ICP and TrICP at
    the paper's budgets (Tables I-III). grasping: objects lifted by a simulated gripper (Table IV)."""
    out: Path
    """Folder for figures (PNG, SVG, PDF), tables (Markdown, LaTeX), claims and numbers (CSV). Stopped or killed, the
    same command goes on."""
    session: Path | None = None
    """Session file (.toml) whose frames are used, ground truth needed; none = built-in scenes, preset published."""
    quick: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Fewer scenes, errors and seeds, same budgets; figures say so."""
    seeds: int | None = None
    """Disturbances of each frame, at most 1000; a later run with more adds to the results."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Worker processes of one thread, no more than 4 per core; results are the same for any number, times aside."""
    settings: AnySettings = field(default_factory=SessionFlags)

    def run(self, arguments: Sequence[str]) -> int:
        check_workers(self.workers)
        check_seeds(self.seeds)
        check_folder(self.out)
        from verefine_viz.studies.study_command import run_one

        overrides = given(self.settings, arguments)
        return run_one(
            self.name,
            self.session,
            self.out,
            overrides,
            quick=self.quick,
            seeds=self.seeds,
            workers=self.workers,
        )
