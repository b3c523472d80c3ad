"""The folder of a batch run: what is in it, who may write to it, and what a restart may build on.

::

    session.toml              exactly what ran, every field explicit
    run.json                  versions, machine, totals
    frames.csv, results.csv   a row per object
    frames.parquet            frames.csv with types and all digits
    .answers                  a copy of all answers, read where no run file has changed since
    motion.csv                the same of a sequence: how poses change from frame to frame
    runs/SSSSSS_IIIIII.vfrun   the run of each frame: iterations and answers
    sequence.rrd              the answers over the frames of a sequence
    recordings/….rrd          one recording per frame
    errors/….txt              tracebacks of frames that failed for an unforeseen reason
    tags.json                 tags and saved filters, made in the page's gallery
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal

import msgspec

import verefine_viz
from verefine_viz.batch.answer_index import INDEX
from verefine_viz.batch.motion_table import MOTION
from verefine_viz.batch.result_tables import TABLES
from verefine_viz.batch.runs import RUN_FILE, Runs, read_run
from verefine_viz.core.errors import InputError, SettingsError, UnavailableError
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import (
    atomic,
    change_in_place,
    check_folder,
    check_no_link,
    clear_parts,
    make_inside,
    path_fault,
    try_lock,
)
from verefine_viz.recording.entities import SEQUENCE_FILE
from verefine_viz.run.session_file import load_session, save_session

SESSION_FILE = "session.toml"
LOCK_FILE = ".lock"
ERRORS = "errors"
_LEFT_BY_A_KILLED_BATCH = (
    *(f"{name}.*.part" for name in (SESSION_FILE, RUN_FILE, MOTION, INDEX, *TABLES)),
    f"{SEQUENCE_FILE}.part", "errors/*.part",
)  # fmt: skip
"""Files that only the process with the lock writes."""


def take_folder(path: Path, mark: str, kind: Literal["batch", "study"]) -> BinaryIO:
    """Makes a folder of results where it is not there, and has this process alone write to it.

    Args:
        path: the folder.
        mark: name of the file that every such folder has.
        kind: what it holds.

    Returns:
        The lock; closing it lets others write to the folder.

    Raises:
        InputError: ``path`` is not a folder, cannot be written, or holds something else.
        UnavailableError: another process is writing to it.
    """
    check_folder(path)
    _check_kind(path, mark, kind)  # Before anything is written: the folder may hold something else.
    make_inside(path)
    lock = try_lock(path / LOCK_FILE)
    if lock is None:
        raise UnavailableError(f"another {kind} is writing to {path}; wait for it or choose another --out")
    try:
        _check_kind(path, mark, kind)
    except BaseException:
        lock.close()
        raise
    return lock


def _check_kind(path: Path, mark: str, kind: str) -> None:
    try:
        if (path / mark).exists() or not path.exists():
            return
        others = sorted(p.name for p in path.iterdir() if p.name != LOCK_FILE and p.suffix != ".part")
    except OSError as error:
        raise _unwritable(path, error) from None
    if others:
        raise InputError(f"{path} holds other files ({others[0]}) and no {kind} run; choose another --out")


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"cannot write to {path}: {path_fault(Path(error.filename or path), error)}")


class RunFolder:
    """A batch folder that this process alone writes to, until :meth:`close`."""

    def __init__(self, path: Path, session: Session) -> None:
        """Begins a run in ``path``, or goes on with the one that is there.

        Raises:
            InputError: ``path`` is not a folder, cannot be written, or holds something else.
            SettingsError: it holds a run of another session or another version.
            UnavailableError: another process is writing to it.
        """
        self.path = path
        self.session = session
        self._lock = take_folder(path, SESSION_FILE, "batch")
        try:
            self._check_session()
            self.save_session()
            make_inside(path, "runs", "recordings")
            check_no_link(path / ERRORS)
            self._clear_parts()
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise _unwritable(path, error) from None
            raise
        self.runs = Runs(path / "runs")

    def close(self) -> None:
        """Lets others write to the folder."""
        self._lock.close()

    def save_session(self) -> None:
        """Writes session.toml where it is missing.

        Raises:
            InputError: the disk refuses.
        """
        if not (self.path / SESSION_FILE).exists():
            save_session(self.session, self.path / SESSION_FILE)

    def mark_stopped(self) -> None:
        """Has run.json say that the batch was stopped, also where a full disk takes no file any more."""
        if (self.path / RUN_FILE).is_file():
            change_in_place(self.path / RUN_FILE, b'"status": "running"', b'"status": "stopped"')

    def write_json(self, name: str, value: Mapping[str, Any]) -> None:
        """Writes a JSON file of the folder, whole or not at all.

        Raises:
            InputError: the disk refuses.
        """
        with atomic(self.path / name) as part:
            part.write_text(json.dumps(value, indent=2, ensure_ascii=False) + "\n", encoding="utf-8", errors="replace")

    def _check_session(self) -> None:
        before = self.path / SESSION_FILE
        if not before.exists():
            return
        difference = first_change(load_session(before), self.session)
        if difference:
            raise SettingsError(
                f"{self.path} holds a run of another session: {difference}; choose another --out, or delete the folder"
            )
        version = read_run(self.path).version or verefine_viz.__version__
        if version != verefine_viz.__version__:
            raise SettingsError(
                f"{self.path} was begun by version {version}, this is {verefine_viz.__version__}: "
                "results would mix; choose another --out"
            )

    def _clear_parts(self) -> None:
        for names in _LEFT_BY_A_KILLED_BATCH:
            for part in self.path.glob(names):
                part.unlink(missing_ok=True)
        clear_parts(self.path)


def first_change(before: Session, now: Session) -> str | None:
    """The first field in which two sessions differ: ``method.name is 'rir' there and 'sir' here``."""
    there, here = _flat(msgspec.to_builtins(before), ""), _flat(msgspec.to_builtins(now), "")
    for field in {**there, **here}:
        before_it, now_it = there.get(field), here.get(field)
        if before_it != now_it:
            if _holds_tables(before_it) or _holds_tables(now_it):
                return f"the [[{field}]] there are others than those here"
            return f"{field} is {_toml_text(before_it)} there and {_toml_text(now_it)} here"
    return None


def _holds_tables(value: Any) -> bool:
    return isinstance(value, tuple | list) and any(isinstance(entry, Mapping) for entry in value)


def _toml_text(value: Any) -> str:
    """A value as it stands in a session file."""
    if value is None:
        return "not set"
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"[{', '.join(map(_toml_text, value))}]" if isinstance(value, tuple | list) else repr(value)


def _flat(value: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, inner in value.items():
        out |= _flat(inner, f"{prefix}{key}.") if isinstance(inner, Mapping) else {f"{prefix}{key}": inner}
    return out
