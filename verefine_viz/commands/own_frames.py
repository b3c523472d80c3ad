"""Which frames a batch covered, as its folder says."""

from __future__ import annotations

import csv
from pathlib import Path

from verefine_viz.batch.index import is_batch_folder
from verefine_viz.evaluation.pose_table import Image


def covered_by(results: Path) -> frozenset[Image] | None:
    """The frames (scene_id, im_id) of the batch that wrote a results.csv, failed ones too.

    None where the file does not lie in a batch's folder, or where its frames.csv cannot be read.
    """
    folder = results.absolute().parent
    if results.name != "results.csv" or not is_batch_folder(folder):
        return None
    try:
        # Two columns of many: the rows are not checked as they are for the page.
        with (folder / "frames.csv").open(encoding="utf-8", newline="") as file:
            return frozenset((int(row["scene_id"]), int(row["im_id"])) for row in csv.DictReader(file))
    except (OSError, ValueError, KeyError, TypeError, csv.Error):
        return None
