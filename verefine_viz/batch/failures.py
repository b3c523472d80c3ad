"""Reports why an item failed; the traceback of an unforeseen error is saved."""

from __future__ import annotations

import traceback
from contextlib import suppress
from pathlib import Path

from verefine_viz.batch.folder import ERRORS
from verefine_viz.batch.machine import temporary_folder
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.writing import DISK_FULL, atomic


def why_failed(error: Exception, out: Path, stem: str) -> str:
    """Why an item failed, a sentence; for an error that is not ours it names the file with the traceback.

    Args:
        error: what was raised.
        out: the folder of results.
        stem: the name of the item's files without their endings.
    """
    if isinstance(error, VerefineError):
        return str(error)
    where = save_traceback(error, out, stem)
    if isinstance(error, OSError) and error.errno in DISK_FULL and error.filename is None:
        return f"no space on the disk of {out} or that of temporary files, {temporary_folder()}: {error.strerror}"
    return f"{type(error).__name__}: {error}{where}"


def save_traceback(error: Exception, out: Path | None, stem: str) -> str:
    """Save the traceback below ``out``; its place as the end of a message, "" where it cannot be saved."""
    if out is None:
        return ""
    log = out / ERRORS / f"{stem}.txt"
    # On a full disk the batch goes on without the traceback.
    with suppress(InputError), atomic(log) as part:
        part.write_text("".join(traceback.format_exception(error)), encoding="utf-8")
    return f" (see {ERRORS}/{log.name})" if log.is_file() else ""
