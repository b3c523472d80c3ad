"""What a path opens: a recorded run, a session, a folder of a batch or of data."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from verefine_viz.core.arguments import checked_path, described
from verefine_viz.core.errors import ArgumentTypeError, InputError
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import expand_home
from verefine_viz.page.gallery import Gallery
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_file import SUFFIX, write_record

TAKES = "a run, as vv.step(frame) or vv.solve(frame) make it, its record, or a path of a run, a session or a folder"


@dataclass(frozen=True)
class Openable:
    """What :class:`verefine_viz.page.app.App` has to open."""

    session: Session
    session_path: Path | None = None
    recording: Path | None = None
    gallery: Gallery | None = None


def read_openable(path: Path) -> Openable:
    """Read what lies at a path.

    Raises:
        VerefineError: nothing that can be opened.
    """
    from verefine_viz.batch.index import is_batch_folder
    from verefine_viz.page.gallery import read_gallery
    from verefine_viz.run.built_in_sessions import named_session
    from verefine_viz.run.data_folder import data_at
    from verefine_viz.run.session_file import load_session

    path = named_session(path)
    if path.suffix in (SUFFIX, ".rrd"):
        if not path.is_file():
            raise InputError(f"{path} does not exist; expected a recorded run (.vfrun, .rrd)")
        return Openable(Session(), recording=path)
    if not is_batch_folder(path) and (known := data_at(path, {})) is not None:
        return Openable(known.session)
    if path.is_dir():
        gallery = read_gallery(path)
        return Openable(gallery.session(gallery.worst.run), gallery=gallery)
    return Openable(load_session(path), path)


def path_of(what: Any, folder: Path) -> Path:
    """Return the path of what can be opened; a run that is in memory is written into ``folder`` first.

    Args:
        what: a record of a run, an object with ``save(path)`` such as the library's run, or a path.
        folder: an empty one.

    Raises:
        InputError: it is nothing of these.
    """
    if isinstance(what, str | os.PathLike):
        return expand_home(str(checked_path(what, "what", TAKES)))
    path = folder / f"run{SUFFIX}"
    if isinstance(what, RunRecord):
        write_record(path, what)
    elif hasattr(what, "record") and not isinstance(what, type):  # A frame, too, can be saved.
        what.save(path)
    else:
        raise ArgumentTypeError(f"{described(what)} cannot be shown, expected {TAKES}")
    return path
