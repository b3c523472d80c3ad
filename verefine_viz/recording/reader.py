"""Opens a recorded run: a run file, or a recording that carries one."""

from __future__ import annotations

from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import reading
from verefine_viz.recording import entities
from verefine_viz.recording.recording_file import read_bytes
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_file import SUFFIX, decoded, read_run_file

_MAGIC = b"RRF2"
_HEAD_BYTES = 12
"""Magic, version, and options, whose last two bytes are reserved."""


def read_recording(path: Path) -> RunRecord:
    """The run in a run file (``.vfrun``) or a recording (``.rrd``).

    Its content is checked here; code that draws it or runs it again relies on this.

    Raises:
        InputError: there is no such file, it is not one of this program, or nothing of a run can be read from it.
    """
    if path.name == entities.SEQUENCE_FILE:
        raise InputError(
            f"{path} goes over the frames of a batch and holds no iterations: verefine-viz replay {path} shows it, "
            f"verefine-viz view {path.parent} the batch, and runs/ there holds the run of each frame"
        )
    if path.suffix == SUFFIX:
        return read_run_file(path)
    check_rerun_file(path)
    content = read_bytes(path, entities.RUN_FILE)
    if content is not None:
        return decoded(content, f"recording {path}")
    beside = _run_file_beside(path)
    if beside is None:
        raise InputError(
            f"{path} holds no run that can be read: it is damaged, its writer was stopped before its end, or another "
            f"program wrote it; expected a recording that view or batch wrote, or the run file ({SUFFIX}) beside it"
        )
    return read_run_file(beside)


def _run_file_beside(path: Path) -> Path | None:
    """The run file of a recording: in its folder, or in ``runs/`` of its batch; None where it is not there."""
    own = path.with_suffix(SUFFIX)
    return next((file for file in (own, path.parent.parent / "runs" / own.name) if file.is_file()), None)


def check_rerun_file(path: Path) -> None:
    """Raise InputError where there is no rerun file at ``path``."""
    with reading(path, "recording") as file:
        head = file.read(_HEAD_BYTES)
    if not head:
        raise InputError(f"{path} is empty; expected a recording (.rrd) that view or batch wrote")
    if not head.startswith(_MAGIC) or head[10:].strip(b"\0"):
        raise InputError(f"{path} is not a rerun recording; expected an .rrd file that view or batch wrote")
