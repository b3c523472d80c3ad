"""Notices that kernels are being compiled: a minute or two in all, once after installing, whatever comes first."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core.event import Event, Listener, install_listener

COMPILING = "Compiling kernels, once after installing; a minute or two in all."


@contextmanager
def told_of_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Inside, ``tell`` is called whenever this thread begins to compile a kernel, also as part of another one.

    Kernels that are read from the disk, where they are kept once they are compiled, are not told of.
    """
    with install_listener("numba:compile", _OfThread(threading.get_ident(), tell)):
        yield


class _OfThread(Listener):
    """Listeners hear of all threads."""

    def __init__(self, thread: int, tell: Callable[[], None]) -> None:
        self._thread, self._tell = thread, tell

    def on_start(self, event: Event) -> None:
        if threading.get_ident() == self._thread:
            self._tell()

    def on_end(self, event: Event) -> None:
        pass
