"""Reports that kernels are being compiled: a minute or two in all, once after installing."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core.event import Event, Listener, install_listener

COMPILING = "Compiling kernels, once after installing; a minute or two in all."


@contextmanager
def compiling_reported(report: Callable[[], None]) -> Iterator[None]:
    """Inside, ``report`` is called whenever this thread begins to compile a kernel, also as part of another one.

    Kernels that are read from the cache on disk are not reported.
    """
    with install_listener("numba:compile", _OfThread(threading.get_ident(), report)):
        yield


class _OfThread(Listener):
    """Listeners get the events of all threads."""

    def __init__(self, thread: int, report: Callable[[], None]) -> None:
        self._thread, self._report = thread, report

    def on_start(self, event: Event) -> None:
        if threading.get_ident() == self._thread:
            self._report()

    def on_end(self, event: Event) -> None:
        pass
