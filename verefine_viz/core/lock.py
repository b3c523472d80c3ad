"""Lock files: held by one process at a time, released by the system when that process ends, however it ends.

A lock file may be one that holds something (a journal). It is opened without being emptied, and never through a link:
what a link leads to belongs to somebody else.
"""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from pathlib import Path
from typing import BinaryIO

from verefine_viz.core.errors import InputError
from verefine_viz.core.places import why_not


def try_lock(file: Path) -> BinaryIO | None:
    """Takes the lock; None where another process holds it.

    Args:
        file: is made if it is not there; its folder is there.

    Returns:
        The file, open for reading and writing; closing it lets go of the lock.

    Raises:
        InputError: it is a link, no regular file, or cannot be written.
    """
    lock = _opened(file)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        return None
    return lock


def wait_for_lock(file: Path) -> BinaryIO:
    """As :func:`try_lock`, but waits until no other process holds it."""
    lock = _opened(file)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
    except BaseException:
        lock.close()
        raise
    return lock


def _opened(file: Path) -> BinaryIO:
    # Not blocking: opening a pipe would wait for its other end.
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        descriptor = os.open(file, flags, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP and file.is_symlink():
            raise InputError(
                f"cannot write {file}: it is a link to {file.readlink()}, expected a file; remove the link"
            ) from None
        raise InputError(f"cannot write {file}: {why_not(file, error)}") from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise InputError(f"cannot write {file}: it is no regular file, expected one")
    return os.fdopen(descriptor, "r+b")
