"""The folder of a batch run: what is in it, who may write to it, and what a restart may build on.

::

    session.toml              exactly what ran, every field explicit
    run.json                  versions, machine, totals
    frames.csv, results.csv   a row per object
    frames/SSSSSS_IIIIII.json the journal: one file per finished frame
    recordings/….rrd          one recording per frame
    errors/….txt              tracebacks of frames that failed for a reason nobody foresaw
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

import verefine_viz
from verefine_viz.batch.journal import Journal
from verefine_viz.core.atomic import atomic
from verefine_viz.core.errors import InputError, SettingsError, UnavailableError
from verefine_viz.core.places import check_folder, why_not
from verefine_viz.core.settings import Session
from verefine_viz.session.files import load_session, save_session

RUN_FILE = "run.json"
TABLES = ("frames.csv", "results.csv")
SESSION_FILE = "session.toml"


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
        self._lock = _locked(path)
        try:
            self._check(session)
            if not (path / SESSION_FILE).exists():
                save_session(session, path / SESSION_FILE)
            for name in ("frames", "recordings"):
                (path / name).mkdir(exist_ok=True)
            self.journal = Journal(path / "frames")
            self.journal.clear_parts()
        except OSError as error:
            self.close()
            raise InputError(f"cannot write to {path}: {why_not(Path(error.filename or path), error)}") from None
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Lets others write to the folder."""
        self._lock.close()

    def write(self, name: str, text: str) -> None:
        """Writes a file of the folder, whole or not at all.

        Raises:
            InputError: the disk refuses.
        """
        with atomic(self.path / name) as part:
            part.write_text(text, encoding="utf-8")

    def write_json(self, name: str, value: Mapping[str, Any]) -> None:
        """:meth:`write` of a JSON object."""
        self.write(name, json.dumps(value, indent=2, ensure_ascii=False) + "\n")

    def read_run(self) -> dict[str, Any]:
        """What run.json says; empty where there is none."""
        return read_run(self.path)

    def _check(self, session: Session) -> None:
        """Whether what lies in the folder is a run of the same session."""
        before = self.path / SESSION_FILE
        if not before.exists():
            others = sorted(p.name for p in self.path.iterdir() if p.name != ".lock" and p.suffix != ".part")
            if others:
                raise InputError(f"{self.path} holds other files ({others[0]}) and no batch run; choose another --out")
            return
        difference = first_change(load_session(before), session)
        if difference:
            raise SettingsError(
                f"{self.path} holds a run of another session: {difference}; choose another --out, or delete the folder"
            )
        version = self.read_run().get("version", verefine_viz.__version__)
        if version != verefine_viz.__version__:
            raise SettingsError(
                f"{self.path} was begun by version {version}, this is {verefine_viz.__version__}: "
                "results would mix; choose another --out"
            )


def read_run(path: Path) -> dict[str, Any]:
    """What the run.json of a batch folder says; empty where there is none.

    Raises:
        InputError: it is not what a batch writes.
    """
    file = path / RUN_FILE
    try:
        value = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read: {error}") from None
    if not isinstance(value, dict):
        raise InputError(f"{file} is not the run.json of a batch: expected a JSON object")
    return value


def first_change(before: Session, now: Session) -> str | None:
    """The first field in which two sessions differ: ``method.name is 'rir' there and 'sir' here``."""
    there, here = _flat(before.model_dump(), ""), _flat(now.model_dump(), "")
    for field in {**there, **here}:
        before_it, now_it = there.get(field), here.get(field)
        if before_it != now_it:
            if _holds_tables(before_it) or _holds_tables(now_it):
                return f"the [[{field}]] there are others than those here"
            return f"{field} is {_as_written(before_it)} there and {_as_written(now_it)} here"
    return None


def _holds_tables(value: Any) -> bool:
    return isinstance(value, tuple | list) and any(isinstance(entry, Mapping) for entry in value)


def _as_written(value: Any) -> str:
    """A value as it stands in a session file."""
    if value is None:
        return "not set"
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"[{', '.join(map(_as_written, value))}]" if isinstance(value, tuple | list) else repr(value)


def _flat(value: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, inner in value.items():
        out |= _flat(inner, f"{prefix}{key}.") if isinstance(inner, Mapping) else {f"{prefix}{key}": inner}
    return out


def _locked(path: Path) -> TextIO:
    """An open lock file in ``path``; the system lets go of it when this process ends, however it ends."""
    check_folder(path)
    file = path / ".lock"
    try:
        path.mkdir(parents=True, exist_ok=True)
        lock = file.open("w")
    except OSError as error:
        raise InputError(f"cannot write to --out {path}: {why_not(file, error)}; choose another --out") from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        raise UnavailableError(f"another batch is writing to {path}; wait for it or choose another --out") from None
    return lock
