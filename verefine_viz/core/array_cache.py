"""A cache on disk for arrays that are slow to make; where it is damaged or unwritable, this costs time only."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.files import reading
from verefine_viz.core.writing import atomic, locked

log = logging.getLogger(__name__)

NPZ_READING = threading.Lock()
"""Held while an .npz file is read: numpy parses its headers with ``ast``, and in Python 3.11 two threads that do so at
the same time can end in "SystemError: AST constructor recursion depth mismatch"."""

T = TypeVar("T")
Arrays = Mapping[str, NDArray[Any]]


def cached(
    file: Path,
    make: Callable[[], T],
    unpack: Callable[[Arrays], T],
    pack: Callable[[T], Mapping[str, ArrayLike]],
    report: Callable[[str], object],
    preparing: str,
    waiting: str,
    is_sound: Callable[[T], bool] = lambda _: True,
) -> T:
    """The content of a cache file; made and written where there is none to use, by one process or thread at a time.

    Args:
        file: .npz; its folder is made.
        make: makes it; what it raises is raised, and nothing is cached.
        unpack: from the file's arrays by name; raises ``ValueError``, ``KeyError`` or a :class:`VerefineError` where
            they are not what it needs.
        pack: the arrays to write.
        report: called with ``preparing`` before it is made, and while another process makes it with ``waiting``, then
            with "" ten times a second; may raise.
        preparing: what is made, in words.
        waiting: what it waits for, in words.
        is_sound: whether what was read can be what is asked for; if not, it is made again.
    """

    def read_sound() -> T | None:
        known = read(file, unpack)
        if known is None or is_sound(known):
            return known
        log.warning("the cached file %s does not hold what its name says and is made again", file)
        return None

    known = read_sound()
    if known is None:
        with locked(file.with_suffix(".lock"), report, waiting):
            known = read_sound()
            if known is None:
                report(preparing)
                known = make()
                write(file, pack(known))
    return known


def read(file: Path, unpack: Callable[[Arrays], T]) -> T | None:
    """Content of a cache file; None where there is no usable one, with a warning where it is damaged."""
    try:
        changed_ns = file.stat().st_mtime_ns
    except FileNotFoundError:
        return None
    except OSError:  # Reading it gives the reason.
        changed_ns = 0
    return _read_as_of(file, changed_ns, unpack)


@lru_cache(maxsize=128)
def _read_as_of(file: Path, changed_ns: int, unpack: Callable[[Arrays], T]) -> T | None:
    """The unpacked file as it was at ``changed_ns`` [ns]; read once."""
    try:
        with reading(file) as stream, NPZ_READING, np.load(stream, allow_pickle=False) as arrays:
            return unpack(arrays)
    except VerefineError as error:
        log.warning("the cached file %s is damaged; it is made again (%s)", file, error)
        return None


def write(file: Path, arrays: Mapping[str, ArrayLike]) -> None:
    """Write arrays to a file, whole or not at all; warn where that is impossible."""
    try:
        with atomic(file) as part, part.open("wb") as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]
    except InputError as error:
        log.warning("it is not cached: %s", error)
