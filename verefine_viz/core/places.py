"""Places on the disk: as people type them, and those that cannot be written to, and why, before the work whose results
they are to hold.
"""

from __future__ import annotations

import errno
import os
import tempfile
from contextlib import suppress
from pathlib import Path

from verefine_viz.core.errors import InputError

LEVELS_BELOW = 3
"""How far below a folder, named by mistake, what was meant is looked for."""
_ABOUT_PLACES = (
    errno.ENOENT, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.ENOTEMPTY, errno.EACCES, errno.EPERM, errno.EROFS,
)  # fmt: skip
"""What the system says about a place, not about what is written there."""


def at_home(text: str) -> Path:
    """The path that a person typed: "~" is the home folder; "~name" stays as it is where nobody is called so."""
    try:
        return Path(text).expanduser()
    except RuntimeError:
        return Path(text)


def why_not(path: Path, error: OSError) -> str:
    """What is wrong with which part of a path that could not be made or written: "/a/b is a file, not a folder"."""
    said = error.strerror or str(error)
    if error.errno not in _ABOUT_PLACES:
        return said
    there = _there(path)
    if there.is_symlink() and not there.exists():
        return f"{there} is a link to {there.readlink()}, which does not exist"
    is_folder = there.is_dir()
    if there == path and is_folder and error.errno in (errno.EISDIR, errno.ENOTEMPTY, errno.EEXIST):
        return f"{there} is a folder"
    if not is_folder and (there != path or error.errno in (errno.EEXIST, errno.ENOTDIR)):
        return f"{there} is a file, not a folder"
    shown = Path.cwd() if there == Path() else there
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"no permission to write {'in ' if is_folder else ''}{shown}"
    return f"{shown} is read-only" if error.errno == errno.EROFS else f"nothing can be made in {shown} ({said})"


def check_folder(path: Path, option: str = "--out") -> None:
    """Tries whether a folder that an option names can be made and written to; nothing is left behind.

    Raises:
        InputError: it is a file, or cannot be made or written to.
    """
    if _there(path) == path and path.is_file():
        raise InputError(f"{option} {path} is a file, expected a folder")
    _try(path, f"{option} {path}", option)


def check_file(path: Path, example: str, option: str = "--out") -> None:
    """The same for a file that an option names.

    Args:
        path: the file.
        example: a name that it could have.
        option: the option.

    Raises:
        InputError: it is a folder, or cannot be written.
    """
    if _there(path) == path and path.is_dir():
        raise InputError(f"{option} {path} is a folder, expected the name of a file, for example {path / example}")
    if is_special(path):
        raise InputError(f"{option} {path} is a device or a pipe, expected the name of a file, for example {example}")
    _try(path.parent, f"{option} {path}", option)


def is_special(path: Path) -> bool:
    """Whether something lies there whose place a file must not take: a device, a pipe, a socket."""
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
        why = why_not(folder / "file", error)
        raise InputError(f"cannot write to {what}: {why}; choose another {option}") from None


def _there(path: Path) -> Path:
    """The longest part of a path that exists, also if it is a link to nothing."""
    # Without an error where nobody may look.
    return next((place for place in (path, *path.parents) if os.path.lexists(place)), path)
