"""A batch folder, read again: which frames to look at first."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from verefine_viz.batch.folder import RUN_FILE, SESSION_FILE, read_run
from verefine_viz.batch.rows import ObjectRow, read_frames_csv
from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.session.files import load_session

Order = Literal["error", "score", "frame"]
ORDERS: tuple[Order, ...] = ("error", "score", "frame")


@dataclass(frozen=True)
class BatchIndex:
    """What ``view DIR`` opens."""

    folder: Path
    session: Session
    """Exactly what ran."""
    run: dict[str, Any]
    """run.json: versions, machine, totals."""
    rows: tuple[ObjectRow, ...]
    """One per object, in the order of frames.csv."""

    def sorted_by(self, order: Order) -> tuple[ObjectRow, ...]:
        """The rows, worst first: failed, without an answer, then by error or by score; or as they ran.

        Error is ADD(-S) as a share of the diameter. Objects without ground truth follow those with, by score.

        Raises:
            SettingsError: there is no such order.
        """
        if order not in ORDERS:
            raise SettingsError(unknown("order", order, ORDERS))
        if order == "frame":
            return self.rows
        return tuple(sorted(self.rows, key=_badness if order == "error" else _by_score))

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames as "scene/image", the one with the worst object first; failed ones, which cannot be opened, last."""
        rows = sorted(self.sorted_by("error"), key=lambda row: row.status == "failed")
        return tuple(dict.fromkeys(f"{row.scene_id}/{row.im_id}" for row in rows))


def is_batch_folder(path: Path) -> bool:
    """Whether ``path`` is what a batch leaves behind."""
    return (path / RUN_FILE).is_file()


def run_folders(folder: Path) -> tuple[Path, ...]:
    """The batch folders in ``folder``: itself, or what ``batch`` with several sessions left in it, by name.

    Raises:
        InputError: there is none.
    """
    if is_batch_folder(folder):
        return (folder,)
    found = tuple(sorted(path for path in folder.iterdir() if is_batch_folder(path))) if folder.is_dir() else ()
    if not found:
        raise InputError(f"{folder} is no folder of a batch: it has no {RUN_FILE}; make one with verefine-viz batch")
    return found


def read_batch(folder: Path) -> BatchIndex:
    """The batch in ``folder``.

    Raises:
        InputError: it is no batch folder, or a file in it is missing or damaged.
    """
    if not is_batch_folder(folder):
        raise InputError(f"{folder} is no folder of a batch: it has no {RUN_FILE}; make one with verefine-viz batch")
    run = read_run(folder)
    session = load_session(folder / SESSION_FILE)
    table = folder / "frames.csv"
    if not table.is_file():
        raise InputError(f"{table} is not there yet: the batch is running or was killed; run it again to finish it")
    try:
        rows = read_frames_csv(table)
    except (ValidationError, ValueError, OSError) as error:
        raise InputError(f"{table} is not what a batch writes: {str(error).splitlines()[0]}") from None
    return BatchIndex(folder, session, run, tuple(rows))


def _badness(row: ObjectRow) -> tuple[int, float]:
    if row.status != "ok":
        return (0 if row.status == "failed" else 1), 0.0
    if row.add_s_mm is None:
        return 3, row.score or 0.0
    return 2, -row.add_s_mm / (row.diameter_mm or 1.0)


def _by_score(row: ObjectRow) -> tuple[int, float]:
    if row.status != "ok":
        return (0 if row.status == "failed" else 1), 0.0
    return 2, row.score or 0.0
