"""Finished batches: which folders hold one, what is in them, and which frames to view first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import structs

from verefine_viz.batch.answer_index import indexed_answers
from verefine_viz.batch.answer_orders import Order, sort_key
from verefine_viz.batch.fix_files import FIX_FOLDER
from verefine_viz.batch.folder import SESSION_FILE
from verefine_viz.batch.runs import RUN_FILE, BatchInfo, Runs, read_run
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.files import LEVELS_BELOW
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.settings import Session
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.run.record import Answer, RunEnd, RunRecord, awaited
from verefine_viz.run.run_file import SUFFIX, read_run_file
from verefine_viz.run.run_header import session_of
from verefine_viz.run.session_file import load_session

if TYPE_CHECKING:
    from verefine_viz.batch.motion_table import MotionTrack


@dataclass(frozen=True)
class BatchIndex:
    """A batch as ``view DIR`` opens it."""

    folder: Path
    session: Session
    """The session that ran."""
    run: BatchInfo
    """run.json: versions, machine, totals."""
    rows: tuple[Answer, ...]
    """One row per object, by frame."""
    notes: tuple[str, ...] = ()
    """What is missing, a sentence each: frames that are not finished, files that cannot be read."""
    motion: Callable[[], tuple[MotionTrack, ...]] | None = None
    """Works out how objects move, while a run goes on; None = read motion.csv, where the frames are a sequence."""

    @cached_property
    def tracks(self) -> tuple[MotionTrack, ...]:
        """The objects over the frames of a sequence; empty where the frames are no sequence.

        Raises:
            InputError: motion.csv is damaged.
        """
        from verefine_viz.batch.motion_table import read_tracks  # Most users of a batch need no motion.

        return read_tracks(self.folder) if self.motion is None else self.motion()

    @cached_property
    def unordered_tracks(self) -> tuple[MotionTrack, ...]:
        """The objects over frames whose order means nothing."""
        from verefine_viz.batch.motion_table import KnownShapes, motion_rows, tracks_of

        of_frame: dict[str, list[Answer]] = {}
        for row in sorted((row for row in self.rows if row.is_object), key=lambda row: parse_frame(row.frame)):
            of_frame.setdefault(row.frame, []).append(row)
        records = (structs.replace(awaited(frame), end=RunEnd(answers=(*rows,))) for frame, rows in of_frame.items())
        return tracks_of(motion_rows(records, KnownShapes({})))

    def sorted_by(self, order: Order) -> tuple[Answer, ...]:
        """The rows in an order, as :func:`sort_key` explains.

        Raises:
            SettingsError: there is no such order.
        """
        return tuple(sorted(self.rows, key=sort_key(order)))

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames as "scene/image", the one with the worst object first; failed ones, which cannot be opened, last."""
        rows = sorted(self.sorted_by("error"), key=lambda row: row.status == "failed")
        return tuple(dict.fromkeys(row.frame for row in rows))

    def answers(self, frame: str) -> dict[int, Float]:
        """instance_id → T_cam_obj (4, 4) [m] of a frame's answers."""
        return {
            row.instance_id: row.T_cam_obj
            for row in self.rows
            if row.frame == frame and row.instance_id is not None and row.T_cam_obj is not None
        }


def is_batch_folder(path: Path) -> bool:
    """Whether ``path`` is the folder of a batch, or of run files; False also where it cannot be read."""
    try:
        return (path / RUN_FILE).is_file() or any(path.glob(f"*{SUFFIX}"))
    except OSError:
        return False


def batch_of(folder: Path) -> Path:
    """The batch folder, where ``folder`` is its folder of run files; else ``folder`` itself."""
    is_of_batch = folder.name == "runs" and (folder.parent / RUN_FILE).is_file()
    return folder.parent if is_of_batch else folder


def has_finished_frame(path: Path) -> bool:
    """Whether a batch folder holds a finished frame, or is a folder of run files."""
    runs = Runs(path / "runs")
    return any(path.glob(f"*{SUFFIX}")) or next(runs.records(runs.frames), None) is not None


@dataclass(frozen=True)
class RunSelection:
    """The batch folders that a folder stands for, by name."""

    runs: tuple[Path, ...]
    note: str
    """Says that they lie in another folder, or that others lie further down; else empty."""


def find_runs(folder: Path) -> RunSelection:
    """The batch folders in ``folder``: itself, or those directly in it, or those of the one folder further down that
    holds any.

    Raises:
        InputError: it is no folder, there is none in it, or several folders further down hold some.
    """
    folder = batch_of(folder)
    if is_batch_folder(folder):
        return RunSelection((folder,), "")
    if why := _folder_fault(folder):
        raise InputError(f"{folder} {why}; expected the folder of a batch run, or of several")
    below = _runs_below(folder, LEVELS_BELOW)
    here = below.pop(folder, ())
    listed = ", ".join(f"{path} ({_counted(runs)})" for path, runs in below.items())
    if here:
        left_out = f"Runs further down are left out; to view them, name their folder: {listed}." if below else ""
        return RunSelection(here, left_out)
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
    ((parent, runs),) = below.items()
    return RunSelection(runs, f"The runs in {parent} ({_counted(runs)}).")


def _folder_fault(path: Path) -> str:
    """Why a folder cannot be read; empty where it can."""
    try:
        if not path.is_dir():
            return "is a file" if path.exists() else "does not exist"
        next(path.iterdir(), None)
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    return ""


def named_runs(folder: Path, inside: str = "") -> str:
    """All runs in ``folder`` and below, or the path ``inside`` each, for a message: ``a/rir, a/sir and 3 more``."""
    in_folder = _runs_below(folder, LEVELS_BELOW).values()
    runs = [folder] if is_batch_folder(folder) else [run for runs in in_folder for run in runs]
    return first_of([run / inside for run in runs], MOST_NAMED)


def _runs_below(folder: Path, levels: int) -> dict[Path, tuple[Path, ...]]:
    """Folders that hold runs, by name, and their runs; folders of runs themselves are not searched."""
    try:
        folders = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError:
        return {}
    runs = tuple(path for path in folders if is_batch_folder(path))
    by_folder = {folder: runs} if runs else {}
    if levels:
        for path in folders:
            # A link could lead back; runs of remedies that were tried do not count.
            if path not in runs and not path.is_symlink() and not (runs and path.name == FIX_FOLDER):
                by_folder |= _runs_below(path, levels - 1)
    return by_folder


def _counted(runs: Sequence[Path]) -> str:
    return f"{len(runs)} run{'s' * (len(runs) != 1)}"


def read_batch(folder: Path) -> BatchIndex:
    """The batch in ``folder``.

    Raises:
        InputError: it is no batch folder, or a file in it is missing or damaged.
    """
    if not is_batch_folder(folder):
        raise InputError(f"{folder} is no folder of a batch: it has no {RUN_FILE}; make one with verefine-viz batch")
    if not (folder / RUN_FILE).is_file():
        return _index_run_files(folder)
    run = read_run(folder)
    session = load_session(folder / SESSION_FILE)
    runs, rows = Runs(folder / "runs"), indexed_answers(folder)
    if rows is None:
        rows = tuple(row for frame in runs.frames for row in _answers(runs.read(frame)))
    if not rows:
        raise InputError(f"{folder} has no finished frame yet: the batch is running or was killed; run it again")
    n_objects, n_written = sum(row.is_object for row in rows), run.totals.objects
    if n_written is not None and n_written != n_objects:
        raise InputError(
            f"{runs.folder} holds {n_objects} objects, but {RUN_FILE} counted {n_written}: it was changed or cut off; "
            "the same batch command solves what is missing"
        )
    n_frames, n_done = run.totals.frames or 0, len({row.frame for row in rows})
    note = f"{n_done} of {n_frames} frames are finished: the batch is running or was stopped"
    return BatchIndex(folder, session, run, rows, (note,) if n_done < n_frames else ())


def _index_run_files(folder: Path) -> BatchIndex:
    """The runs of a folder that holds run files only, under any names.

    Raises:
        InputError: a file cannot be read, none holds a finished run, or they are runs on different data.
    """
    finished, sessions, notes = list[RunRecord](), list[Session](), list[str]()
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        try:
            record = read_run_file(path, with_iterations=False)
            if record.end is None:
                notes.append(f"{path.name}: {record.missing}")
                continue
            sessions.append(session_of(record.header))
            finished.append(record)
        except InputError as error:
            notes.append(str(error))
        except SettingsError as error:
            notes.append(f"{path.name}: {error}")
    if not finished:
        raise InputError(f"{folder} holds no finished run: {first_of(notes, MOST_NAMED, '; ')}")
    frames = tuple(dict.fromkeys(record.header.frame for record in finished))
    sessions = [_on(frames, session) for session in sessions]
    if any((one.scene, one.hypotheses) != (sessions[0].scene, sessions[0].hypotheses) for one in sessions):
        raise InputError(f"{folder} holds runs on different data; open them one by one, or two side by side")
    rows = tuple(row for record in finished for row in _answers(record))
    return BatchIndex(folder, sessions[0], BatchInfo(), rows, tuple(notes))


def _on(frames: tuple[str, ...], session: Session) -> Session:
    return structs.replace(session, scene=structs.replace(session.scene, frames=frames))


def _answers(record: RunRecord | None) -> tuple[Answer, ...]:
    return () if record is None or record.end is None else record.end.answers
