"""``verefine-viz evaluate``: BOP scores of results files against a data set's ground truth."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from verefine_viz.commands.flags import check_workers
from verefine_viz.core.errors import SettingsError


@dataclass(frozen=True)
class EvaluateCommand:
    """Score results files as the BOP toolkit does: AR over VSD, MSSD and MSPD (BOP'19), or mean precision (BOP'24)."""

    results: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RESULTS.csv [RESULTS.csv ...]")]
    """Results files in BOP format, such as a batch's results.csv; each becomes a row of the table. One about a part of
    the targets only is scored over this part as well (the folder of a batch names the frames and objects to solve);
    one about none of the targets is refused."""
    dataset: Path
    """Folder of the data set, with models_eval/ (or models/), and the split."""
    split: str = ""
    """The split's folder; by default test, or the only one that begins with it (test_primesense)."""
    sensor: str = ""
    """The sensor whose camera the poses are in (cam1, photoneo, xyz), where the scenes have several; by default the
    first one with ground truth."""
    targets: Path | None = None
    """Targets file, or its name in the data set's folder; by default test_targets_bop19.json, else …_bop24.json;
    without either, all instances that are at least 10 % visible are asked for."""
    task: Literal["auto", "localization", "detection"] = "auto"
    """localization: BOP'19 to '23, average recall. detection: BOP'24, average precision. auto: by the targets
    file."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print JSON instead of a table: all recalls, per object, over own images, counts, seconds."""
    per_object: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Also print a table by object for each results file."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Threads, no more than 4 per core; the scores are the same for any number."""

    def run(self, arguments: Sequence[str]) -> int:
        if not self.results:
            raise SettingsError("no results file given; use verefine-viz evaluate RESULTS.csv --dataset FOLDER")
        check_workers(self.workers)
        from verefine_viz.commands.score_output import print_scores

        task = None if self.task == "auto" else self.task
        print_scores(
            self.results,
            self.dataset,
            self.split,
            self.targets,
            task,
            self.workers,
            self.json,
            self.per_object,
            self.sensor,
        )
        return 0
