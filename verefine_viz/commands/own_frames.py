"""Which frames and objects a batch covered, as its folder says."""

from __future__ import annotations

import csv
from io import TextIOWrapper
from pathlib import Path

from verefine_viz.batch.folder import SESSION_FILE
from verefine_viz.batch.index import is_batch_folder
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.input_files import open_input
from verefine_viz.evaluation.coverage import Covered
from verefine_viz.session.files import load_session


def covered_by(results: Path) -> Covered | None:
    """The frames of the batch that wrote a results.csv, failed ones too, and the objects that its session names.

    None where the file does not lie in a batch's folder, or where its frames.csv cannot be read.
    """
    folder = results.absolute().parent
    if results.name != "results.csv" or not is_batch_folder(folder):
        return None
    try:
        # Two columns of many: the rows are not checked as they are for the page.
        with TextIOWrapper(open_input(folder / "frames.csv"), encoding="utf-8", newline="") as file:
            images = frozenset((int(row["scene_id"]), int(row["im_id"])) for row in csv.DictReader(file))
    except (VerefineError, OSError, ValueError, KeyError, TypeError, csv.Error):
        return None
    return Covered(images, _objects(folder / SESSION_FILE))


def _objects(session: Path) -> frozenset[int] | None:
    """What the session asks for; None = all, also where it cannot be read."""
    try:
        return frozenset(load_session(session).scene.objects) or None
    except VerefineError:
        return None
