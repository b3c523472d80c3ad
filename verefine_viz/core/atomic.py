"""Files are written whole or not at all."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from verefine_viz.core.errors import InputError
from verefine_viz.core.places import why_not

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says when a disk, a quota or a file is full."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A path to write to, beside ``path``; it takes the place of ``path`` when the block ends without an error.

    Raises:
        InputError: the file cannot be written; nothing half-written stays.
    """
    # Named after its writer: two processes, or threads, that write the same file must not share what is half-written.
    part = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {why_not(path, error)}") from None
    finally:
        with suppress(OSError):
            part.unlink()
