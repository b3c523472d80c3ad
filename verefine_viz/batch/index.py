"""A batch folder, read again: which frames to look at first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from verefine_viz.batch.folder import SESSION_FILE
from verefine_viz.batch.journal import RUN_FILE, Journal, RunFile, read_run
from verefine_viz.batch.rows import ObjectRow, read_frames_csv
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.paths import LEVELS_BELOW
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.session.files import load_session

Order = Literal["error", "score", "misleading", "cause", "object", "frame"]
ORDERS: tuple[Order, ...] = ("error", "score", "misleading", "cause", "object", "frame")


@dataclass(frozen=True)
class BatchIndex:
    """What ``view DIR`` opens."""

    folder: Path
    session: Session
    """Exactly what ran."""
    run: RunFile
    """run.json: versions, machine, totals."""
    rows: tuple[ObjectRow, ...]
    """One per object, in the order of frames.csv."""

    def sorted_by(self, order: Order) -> tuple[ObjectRow, ...]:
        """The rows in one of :data:`ORDERS`, see :func:`place_in`.

        Raises:
            SettingsError: there is no such order.
        """
        return tuple(sorted(self.rows, key=place_in(order)))

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames as "scene/image", the one with the worst object first; failed ones, which cannot be opened, last."""
        rows = sorted(self.sorted_by("error"), key=lambda row: row.status == "failed")
        return tuple(dict.fromkeys(row.frame for row in rows))

    def answers(self, frame: str) -> dict[int, Float]:
        """instance_id → T_cam_obj (4, 4) [m] of a frame's answers; empty where the journal is gone."""
        result = Journal(self.folder / "frames").read(frame)
        if result is None:
            return {}
        # Estimates are there for the objects that got an answer, in their order.
        solved = [row for row in result.objects if row.status == "ok"]
        return {
            row.instance_id: np.array(estimate.T_cam_obj).reshape(4, 4)
            for row, estimate in zip(solved, result.estimates, strict=False)
            if row.instance_id is not None and row.obj_id == estimate.obj_id
        }


def is_batch_folder(path: Path) -> bool:
    """Whether ``path`` is what a batch leaves behind; a folder that cannot be looked into is not."""
    try:
        return (path / RUN_FILE).is_file()
    except OSError:
        return False


@dataclass(frozen=True)
class FoundRuns:
    """What a folder holds."""

    runs: tuple[Path, ...]
    """The batch folders that are meant, by name."""
    note: str
    """Where they lie if that is not ``folder`` itself, or that others lie further down; empty if nothing is to say."""


def find_runs(folder: Path) -> FoundRuns:
    """The batch folders in ``folder``: itself, or what ``batch`` with several sessions left in it; where none lies
    directly in it, those of the one folder further down that holds any.

    Raises:
        InputError: it is no folder, there is none in it, or several folders further down hold some.
    """
    if is_batch_folder(folder):
        return FoundRuns((folder,), "")
    if why := _no_folder(folder):
        raise InputError(f"{folder} {why}; expected the folder of a batch run, or of several")
    below = _runs_below(folder, LEVELS_BELOW)
    here = below.pop(folder, ())
    listed = ", ".join(f"{path} ({_counted(runs)})" for path, runs in below.items())
    if here:
        left_out = f"Runs further down are left out; to look at them, name their folder: {listed}." if below else ""
        return FoundRuns(here, left_out)
    if len(below) > 1:
        folders = (
            f"{p} ({_counted(runs)}: {first_of([run.name for run in runs], MOST_NAMED)})" for p, runs in below.items()
        )
        raise InputError(
            f"{folder} holds no run itself, and several folders in it do; name one of them: {'; '.join(folders)}"
        )
    if not below:
        session = folder / SESSION_FILE
        opens = f"its session opens by verefine-viz view {session}"
        hint = opens if session.is_file() else "make one with verefine-viz batch"
        raise InputError(f"{folder} is no folder of a batch: it has no {RUN_FILE}; {hint}")
    ((place, runs),) = below.items()
    return FoundRuns(runs, f"The runs in {place} ({_counted(runs)}).")


def _no_folder(path: Path) -> str:
    """Why nobody can look into it; empty where one can."""
    try:
        if not path.is_dir():
            return "is a file" if path.exists() else "does not exist"
        next(path.iterdir(), None)
    except OSError as error:
        return f"cannot be looked into ({error.strerror})"
    return ""


def run_folders(folder: Path) -> tuple[Path, ...]:
    """The runs that :func:`find_runs` finds."""
    return find_runs(folder).runs


def runs_in(folder: Path) -> tuple[Path, ...]:
    """All runs in ``folder`` and below, for those who named it by mistake; none where it is no folder."""
    if is_batch_folder(folder):
        return (folder,)
    return tuple(run for runs in _runs_below(folder, LEVELS_BELOW).values() for run in runs)


def named_runs(folder: Path, inside: str = "") -> str:
    """The runs of :func:`runs_in` in a row, as in: a/rir, a/sir and 3 more.

    Args:
        folder: what was named.
        inside: what of each run is named.
    """
    return first_of([run / inside for run in runs_in(folder)], MOST_NAMED)


def _runs_below(folder: Path, levels: int) -> dict[Path, tuple[Path, ...]]:
    """Folders that hold runs, by name, and their runs; what lies in a run is its own."""
    try:
        folders = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError:
        return {}
    runs = tuple(path for path in folders if is_batch_folder(path))
    found = {folder: runs} if runs else {}
    if levels:
        for path in folders:
            # A link could lead back.
            if path not in runs and not path.is_symlink():
                found |= _runs_below(path, levels - 1)
    return found


def _counted(runs: Sequence[Path]) -> str:
    return f"{len(runs)} run{'s' * (len(runs) != 1)}"


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
        raise InputError(
            f"{table} is not there yet: the batch is running or was killed; run it again to finish it"
            + _finished_frame(folder)
        )
    rows = read_frames_csv(table)
    n_objects, n_written = sum(row.is_object for row in rows), run.totals.objects
    if n_written is not None and n_written != n_objects:
        raise InputError(
            f"{table} holds {n_objects} objects, but {RUN_FILE} counted {n_written}: it was changed or cut off; "
            "the same batch command writes it again"
        )
    return BatchIndex(folder, session, run, tuple(rows))


def _finished_frame(folder: Path) -> str:
    """How to look at a frame of a batch that has not ended; empty where no recording of one is there."""
    last = max((folder / "recordings").glob("*.rrd"), key=lambda path: path.name, default=None)
    return f". Frames that are done can be opened one by one: verefine-viz view {last}" if last else ""


def place_in(order: Order) -> Callable[[ObjectRow], tuple[Any, ...]]:
    """What to sort rows by.

    error: failed, without an answer, then by error, the largest first. score: the same with the lowest score first.
    misleading: wrong answers, the best scored first. cause, object: by name, each by error. frame: as they ran. Error
    is ADD(-S) as a share of the diameter; objects without ground truth follow those with, by score.

    Raises:
        SettingsError: there is no such order.
    """
    if order not in ORDERS:
        raise SettingsError(unknown("order", order, ORDERS))
    return _PLACES[order]


def _badness(row: ObjectRow) -> tuple[int, float]:
    if row.status != "ok":
        return (0 if row.status == "failed" else 1), 0.0
    if row.relative_error is None:
        return 3, row.score or 0.0
    return 2, -row.relative_error


def _by_score(row: ObjectRow) -> tuple[int, float]:
    if row.status != "ok":
        return (0 if row.status == "failed" else 1), 0.0
    return 2, row.score or 0.0


_PLACES: dict[Order, Callable[[ObjectRow], tuple[Any, ...]]] = {
    "error": _badness,
    "score": _by_score,
    "misleading": lambda row: (row.is_correct is not False, -(row.score or 0.0)),
    "cause": lambda row: (not row.cause, row.cause, *_badness(row)),
    "object": lambda row: (row.name, *_badness(row)),
    "frame": lambda row: (),
}
