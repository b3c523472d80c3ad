"""Kernels (core/kernels.py) are compiled when they are first used, a minute or two in all: says so, and has one process
do it for all.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path

import platformdirs
from numba.core.event import Event, Listener, install_listener

from verefine_viz.core.writing import locked

COMPILING = "Compiling kernels that are used for the first time; after installing up to two minutes in all."


@contextmanager
def compiling_reported(
    report: Callable[[], None], timed: Callable[[], AbstractContextManager[object]] = nullcontext
) -> Iterator[None]:
    """Inside, ``report`` is called whenever this thread begins to compile a kernel, also as part of another one.

    ``timed`` is entered while it compiles one, with its parts and with what ``report`` takes. Kernels that are read
    from the cache on disk are not reported.
    """
    with install_listener("numba:compile", _OfThread(threading.get_ident(), report, timed)):
        yield


class _OfThread(Listener):
    """Listeners get the events of all threads."""

    def __init__(
        self, thread: int, report: Callable[[], None], timed: Callable[[], AbstractContextManager[object]]
    ) -> None:
        self._thread, self._report, self._timed = thread, report, timed
        self._depth = 0
        self._watch = ExitStack()

    def on_start(self, event: Event) -> None:
        if threading.get_ident() == self._thread:
            if self._depth == 0:
                self._watch.enter_context(self._timed())
            self._depth += 1
            self._report()

    def on_end(self, event: Event) -> None:
        if threading.get_ident() == self._thread:
            self._depth -= 1
            if self._depth == 0:
                self._watch.close()


class CompilingTurn:
    """A turn: of several processes that begin together one compiles; the others wait and find its kernels in the cache.

    For processes that compile on one thread: one that waits holds numba's own lock.

    Args:
        file: the lock file; None = in the user's cache folder.
    """

    def __init__(self, file: Path | None = None) -> None:
        self._file = platformdirs.user_cache_path("verefine-viz") / "compiling.lock" if file is None else file
        self._held = ExitStack()
        self._is_mine = False

    def take(self) -> None:
        """Before a kernel is compiled: at once, and then until :meth:`end`; or after the process that had it first.

        A process that had to wait compiles the one kernel that it lacked, and does not keep others waiting for that.
        """
        if self._is_mine:
            return
        waited: list[str] = []
        self._held.enter_context(locked(self._file, waited.append, ""))
        self._is_mine = True
        if waited:
            self.end()

    def end(self) -> None:
        """A frame is solved: most of what it needs is compiled."""
        self._held.close()
        self._is_mine = False
