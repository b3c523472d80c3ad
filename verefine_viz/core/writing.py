"""Places to write to, whole-or-nothing writes, JSON files and lock files."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import shutil
import stat
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from verefine_viz.core.errors import InputError

DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of the system when a disk, a quota or a file is full."""


def expand_home(text: str) -> Path:
    """The path that the user typed: "~" is the home folder; "~name" stays as it is where there is no such user."""
    try:
        return Path(text).expanduser()
    except RuntimeError:
        return Path(text)


def path_fault(path: Path, error: OSError) -> str:
    """The system's reason why a path cannot be made or written, after the part of the path that exists:
    "/a/b is a file: Not a directory".
    """
    message = error.strerror or str(error)
    if error.errno in DISK_FULL:
        return message
    there = _there(path.absolute())
    if error.errno == errno.ENOENT and there.is_dir():
        return f"no file can be made in {there}"
    kind = f"a link to {there.readlink()}" if there.is_symlink() else "a folder" if there.is_dir() else "a file"
    return f"{there} is {kind}: {message}"


def check_folder(path: Path, option: str = "--out") -> None:
    """Check that the folder that an option names can be made and written to; nothing is left behind.

    Raises:
        InputError: it is a file, or cannot be made or written to.
    """
    if _there(path) == path and path.is_file():
        raise InputError(f"{option} {path} is a file, expected a folder")
    _try(path, f"{option} {path}", option)


def check_file(path: Path, example: str, option: str = "--out") -> None:
    """Check that the file that an option names can be written.

    Args:
        path: the file.
        example: a name that it could have.
        option: the option.

    Raises:
        InputError: it is a folder, or cannot be written.
    """
    if _there(path) == path and path.is_dir():
        raise InputError(f"{option} {path} is a folder, expected the name of a file, for example {path / example}")
    if _is_special(path):
        raise InputError(f"{option} {path} is a device or a pipe, expected the name of a file, for example {example}")
    _try(path.parent, f"{option} {path}", option)


def _is_special(path: Path) -> bool:
    """Whether there is something that a file must not replace: a device, a pipe, a socket."""
    try:
        return path.exists() and not (path.is_file() or path.is_dir())
    except OSError:
        return False


def _try(folder: Path, what: str, option: str) -> None:
    try:
        with suppress(FileNotFoundError):
            os.stat(folder)  # noqa: PTH116 (a name that is too long, a loop of links)
        with tempfile.TemporaryFile(dir=_there(folder)):
            pass
    except OSError as error:
        why = path_fault(folder / "file", error)
        raise InputError(f"cannot write to {what}: {why}; choose another {option}") from None


def _there(path: Path) -> Path:
    """The longest part of a path that exists, also if it is a link to nothing; no error where permission is missing."""
    return next((part for part in (path, *path.parents) if os.path.lexists(part)), path)


# What a folder of ours holds is ours to replace, but a link in it may lead to anything: nothing is written through one.
# Only a folder that the user names may be a link itself.


def new_file(path: Path) -> int:
    """Make an empty file; an existing file or link is replaced, never the target of a link.

    Returns:
        Its descriptor, for writing; the caller closes it.

    Raises:
        InputError: there is a device, a pipe or a folder, or no file can be made there.
    """
    if _is_special(path):
        raise InputError(f"cannot write {path}: it is a device or a pipe, expected a file")
    try:
        with suppress(FileNotFoundError):
            path.unlink()
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise InputError(f"cannot write {path}: {path_fault(path, error)}") from None


def make_inside(folder: Path, *inside: str) -> None:
    """Make a folder, and folders inside it by their relative paths, where they do not exist.

    Raises:
        InputError: one inside is a link, or one cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for part in dict.fromkeys(name for path in inside for name in (*reversed(Path(path).parents[:-1]), Path(path))):
            check_no_link(folder / part)
            (folder / part).mkdir(exist_ok=True)
    except OSError as error:
        path = Path(error.filename or folder)
        raise InputError(f"cannot write to {path}: {path_fault(path, error)}") from None


def check_no_link(path: Path) -> None:
    """Raise InputError where a folder inside one of ours is a link."""
    if path.is_symlink():
        where = path.readlink()
        raise InputError(f"cannot write to {path}: it is a link to {where}, expected a folder; remove the link")


# Output files are written whole or not at all.

_PART = re.compile(r".+\.(\d+)-\d+\.part")
"""The name of a half-written file: the file's own, then its writer's process and thread."""


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A path to write to, beside ``path``; it replaces ``path`` when the block ends without an error.

    Raises:
        InputError: the file cannot be written; nothing half-written stays.
    """
    # Named after its writer: two processes, or threads, that write the same file must not share what is half-written.
    part = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    if _is_special(path):
        raise InputError(f"cannot write {path}: it is a device or a pipe, expected a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        os.close(new_file(part))
        yield part
        part.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {path_fault(path, error)}") from None
    finally:
        with suppress(OSError):
            part.unlink()


def write_json(path: Path, content: Any) -> None:
    """Write ``content``, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic(path) as part:
        part.write_text(json.dumps(content, indent=1), encoding="utf-8")


def change_in_place(file: Path, before: bytes, after: bytes) -> None:
    """Overwrite some bytes of a file of ours by as many others, which needs no room on the disk.

    Nothing is done where the file does not hold them, or cannot be written.
    """
    assert len(before) == len(after)
    with suppress(OSError, InputError), _opened(file) as opened:
        at = opened.read().find(before)
        if at >= 0:
            os.pwrite(opened.fileno(), after, at)


def clear_parts(folder: Path, of: str = "") -> None:
    """Remove files and folders that killed processes left half-written in a folder; those of running processes stay.

    Args:
        folder: need not exist.
        of: beginnings of the names to remove.
    """
    for part in folder.glob("*.part"):
        writer = _PART.fullmatch(part.name)
        if writer and part.name.startswith(of) and not _is_running(int(writer[1])):
            with suppress(OSError):
                if part.is_dir() and not part.is_symlink():
                    shutil.rmtree(part)
                else:
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


# Lock files: held by one process at a time, released by the system when that process ends, however it ends.
#
# A lock file may be one that holds something (a journal). It is opened without being emptied, and never through a
# link, which may lead to a file of something else.


def try_lock(file: Path) -> BinaryIO | None:
    """Take a lock; None where another process holds it.

    Args:
        file: is made if it does not exist; its folder must exist.

    Returns:
        The file, open for reading and writing; closing it releases the lock.

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


@contextmanager
def locked(file: Path, asked: Callable[[str], object], waiting: str) -> Iterator[None]:
    """Keep other processes and threads with the same lock file out of the block; the file is removed afterwards.

    Where no lock file can be made (a cache that cannot be written to) several may be inside at once, which costs
    time only.

    Args:
        file: the lock file; its folder is made.
        asked: called with ``waiting`` where it has to wait, then with "" ten times a second; may raise.
        waiting: what it waits for, in words.
    """
    lock = None
    with suppress(InputError, OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        while (lock := try_lock(file)) is None:
            asked(waiting)
            waiting = ""
            time.sleep(0.1)
    try:
        yield
    finally:
        if lock is not None:
            with suppress(OSError):
                file.unlink()
            lock.close()


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
        raise InputError(f"cannot write {file}: {path_fault(file, error)}") from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise InputError(f"cannot write {file}: it is no regular file, expected one")
    return os.fdopen(descriptor, "r+b")
