"""Files are written whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.places import is_special, why_not

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says when a disk, a quota or a file is full."""
_PART = re.compile(r".+\.(\d+)-\d+\.part")
"""The name of a half-written file: the file's own, then its writer's process and thread."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A path to write to, beside ``path``; it takes the place of ``path`` when the block ends without an error.

    Raises:
        InputError: the file cannot be written; nothing half-written stays.
    """
    # Named after its writer: two processes, or threads, that write the same file must not share what is half-written.
    part = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    if is_special(path):
        raise InputError(f"cannot write {path}: it is a device or a pipe, expected a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {why_not(path, error)}") from None
    finally:
        with suppress(OSError):
            part.unlink()


def clear_parts(folder: Path, of: str = "") -> None:
    """Removes what killed processes left half-written in a folder; what others are just writing stays.

    Args:
        folder: it need not be there.
        of: how the names of the files begin that are meant.
    """
    for part in folder.glob("*.part"):
        writer = _PART.fullmatch(part.name)
        if writer and part.name.startswith(of) and not _is_running(int(writer[1])):
            with suppress(OSError):
                part.unlink()


def _is_running(pid: int) -> bool:
    if pid == os.getpid():
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True  # It belongs to another user.
    return True
