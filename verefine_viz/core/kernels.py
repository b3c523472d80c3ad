"""Compiled functions, and the folder in which they are cached.

Numba unpickles the list of what it has cached of a function before it compares the source's stamp: a list that names a
type which a newer version renamed raises ``AttributeError``. So each version of the sources has a folder of its own,
and those of older ones are removed.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import platformdirs
from numba import config, njit
from numba.core import event
from numba.core.dispatcher import Dispatcher

from verefine_viz import __version__
from verefine_viz.core.clock import clock
from verefine_viz.core.errors import InputError
from verefine_viz.core.writing import atomic, wait_for_lock

PACKAGE = Path(__file__).resolve().parents[1]
OF_KERNELS = (b"@kernel", b"(NamedTuple)")
"""Text that the source of a kernel, or of a type passed to one, contains."""
OWNER = "verefine-viz.txt"
"""File in each folder that names the package it was made for."""
LOCK = "saving.lock"
"""A file beside the kernels of a module, which is locked while one is saved."""

F = TypeVar("F", bound=Callable[..., Any])


def kernel(nogil: bool = False) -> Callable[[F], F]:
    """Compile a function by numba when it is first called, and cache it on disk.

    Args:
        nogil: whether other threads run beside it.
    """

    def compiled(function: F) -> F:
        # Numba decides here where to cache it; kernels of a user's program stay where they are.
        before, config.CACHE_DIR = config.CACHE_DIR, str(cache_folder())  # pyright: ignore
        try:
            dispatcher: Any = njit(cache=True, nogil=nogil)(function)
        finally:
            config.CACHE_DIR = before  # pyright: ignore
        if isinstance(dispatcher, Dispatcher):  # With NUMBA_DISABLE_JIT it is the function.
            _save_one_at_a_time(dispatcher)
        return cast(F, dispatcher)

    return compiled


def _save_one_at_a_time(dispatcher: Any) -> None:
    """Have the processes that save a kernel wait for each other.

    Numba numbers what it saves of a function, for one type of arguments after the other, by the list that is on disk.
    Two processes that read the list at the same time take the same number, and one type is then run by the code of the
    other: wrong numbers, without an error.
    """
    file = dispatcher._cache._cache_file
    save, lock = file.save, Path(file._cache_path) / LOCK

    def saved(key: object, data: object) -> None:
        with wait_for_lock(lock):
            save(key, data)

    file.save = saved


@cache
def cache_folder() -> Path:
    """Return the folder of this version's kernels, below NUMBA_CACHE_DIR where that is set; older ones are removed."""
    chosen = config.CACHE_DIR  # pyright: ignore
    root = Path(chosen) if chosen else platformdirs.user_cache_path("verefine-viz") / "kernels"
    return made_folder(root, PACKAGE, __version__)


def made_folder(root: Path, package: Path, version: str) -> Path:
    """Make the folder of a package's kernels, and remove those of its older versions and of packages that are gone.

    Args:
        root: the folder in which such folders are.
        package: the folder of the package's sources.
        version: that of the package.

    Returns:
        The folder, named by version, place and sources. Where it cannot be made numba caches elsewhere.
    """
    source = hashlib.sha256(bytes(package))
    for file in sorted(package.rglob("*.py")):
        content = file.read_bytes()
        if any(sign in content for sign in OF_KERNELS):
            source.update(content)
    folder = root / f"verefine-viz-{version}-{source.hexdigest()[:12]}"
    with suppress(OSError, InputError):
        if not folder.exists():
            folder.mkdir(parents=True)
            with atomic(folder / OWNER) as part:
                part.write_bytes(bytes(package))
            for owner in root.glob(f"*/{OWNER}"):
                made_by = Path(owner.read_text(encoding="utf-8", errors="surrogateescape"))
                if owner.parent != folder and (made_by == package or not made_by.is_dir()):
                    shutil.rmtree(owner.parent, ignore_errors=True)
    return folder


class _StopsTheClock(event.Listener):
    """Leaves the time in which kernels are compiled out of the times of a run."""

    def on_start(self, event: event.Event) -> None:
        clock.stop()

    def on_end(self, event: event.Event) -> None:
        clock.resume()


event.register("numba:compile", _StopsTheClock())
