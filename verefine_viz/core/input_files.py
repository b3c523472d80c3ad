"""Opens input files: a pipe, a device, a loop of links or a NUL in a name is one clear line and no hang."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from verefine_viz.core.errors import InputError, quoted

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def open_input(path: Path, label: str = "") -> BinaryIO:
    """The regular file at ``path``, open for reading; the caller closes it.

    Args:
        path: the file; links are followed.
        label: what the file is, before its path in messages ("session file").

    Raises:
        InputError: it is missing, cannot be read, or is no regular file.
    """
    name = f"{label} {path}".lstrip()
    try:
        # Before it is opened: opening a device can do something, and opening a pipe waits for its other end.
        _check_regular(os.stat(path), name)  # noqa: PTH116
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise InputError(f"{name} does not exist") from None
    except ValueError:
        raise InputError(f"{label} {quoted(str(path))} is no path: it holds a NUL character".lstrip()) from None
    except OSError as error:
        raise InputError(f"{name} cannot be read: {error.strerror}") from None
    try:
        _check_regular(os.fstat(descriptor), name)  # It may have been replaced in between.
    except InputError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")


def read_input(path: Path, label: str = "") -> bytes:
    """All bytes of the regular file at ``path``; as :func:`open_input`.

    Raises:
        InputError: it is missing, cannot be read, or is no regular file.
    """
    with open_input(path, label) as file:
        try:
            return file.read()
        except OSError as error:
            raise InputError(f"{label} {path} cannot be read: {error.strerror}".lstrip()) from None


def check_input(path: Path, label: str = "") -> None:
    """Nothing, if ``path`` can be opened by a library that takes a path; as :func:`open_input`.

    Raises:
        InputError: it is missing, cannot be read, or is no regular file.
    """
    open_input(path, label).close()


def _check_regular(status: os.stat_result, name: str) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = next((kind for is_kind, kind in _KINDS if is_kind(status.st_mode)), "something else")
        raise InputError(f"{name} is {kind}, expected a file")
