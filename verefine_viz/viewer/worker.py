"""The queue between the page and its worker thread, and cancelling what the worker is doing."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from verefine_viz.viewer.commands import Cancel, Command

STOP = object()
"""What the worker takes instead of a command when it is to end."""


class RequestQueue:
    """The queue between the page, or a script, and the worker.

    Args:
        on_cancel: called, on the thread that asks for it, before what the worker is at is cancelled.
    """

    def __init__(self, on_cancel: Callable[[], None] = lambda: None) -> None:
        self._on_cancel = on_cancel
        self._queue: deque[Command] = deque()
        self._wake = threading.Condition()
        self._stopping = False
        self._idle = False
        self._can_cancel = False
        self._cancelled = False
        self._is_aside = False

    @property
    def are_wanted(self) -> bool:
        """Whether what the worker is at is still wanted."""
        return not (self._cancelled or self._stopping or (self._is_aside and self._queue))

    @property
    def can_cancel(self) -> bool:
        """Whether what the worker is at may be left undone."""
        return self._can_cancel

    @contextmanager
    def cancellable(self) -> Iterator[None]:
        """What the worker does inside may be left undone: ``Cancel`` has it no longer wanted."""
        with self._wake:
            self._can_cancel = True
        try:
            yield
        finally:
            with self._wake:
                self._can_cancel = self._cancelled = False

    @contextmanager
    def aside(self) -> Iterator[None]:
        """What the worker does inside is no longer wanted once somebody asks for anything."""
        self._is_aside = True
        try:
            yield
        finally:
            self._is_aside = False

    def send(self, command: Command) -> None:
        """Puts a command into the queue; returns at once.

        ``Cancel`` overtakes all others, and takes with it what waits: that was meant for what was to come.
        """
        with self._wake:
            if isinstance(command, Cancel):
                return self._cancel()
            if command.latest_wins and self._queue and type(self._queue[-1]) is type(command):
                self._queue[-1] = command
            else:
                self._queue.append(command)
            self._idle = False
            self._wake.notify_all()

    def take(self, wait_s: float | None) -> Command | object | None:
        """The next command; None = nothing waits, go on with what is under way; STOP = end.

        Args:
            wait_s: how long to wait for one [s]; None = nothing is under way, wait until one comes.
        """
        with self._wake:
            if not self._queue and wait_s != 0:
                if wait_s is None:
                    self._idle = True
                    self._wake.notify_all()
                self._wake.wait_for(lambda: self._queue or self._stopping, wait_s)
            if self._stopping:
                return STOP
            return self._queue.popleft() if self._queue else None

    def take_looking(self) -> Command | None:
        """The next command if it only looks; does not wait for one."""
        with self._wake:
            return self._queue.popleft() if self._queue and self._queue[0].only_looks else None

    def holds(self, kind: type[Command] = Command) -> bool:
        """Whether a command of that kind waits."""
        with self._wake:
            return any(isinstance(waiting, kind) for waiting in self._queue)

    def wait_until_idle(self, timeout_s: float) -> None:
        """Waits until every command so far is carried out and nothing is under way."""
        with self._wake:
            if not self._wake.wait_for(lambda: self._idle and not self._queue, timeout_s):
                raise TimeoutError(f"still busy after {timeout_s} s")

    def stop(self) -> None:
        """Ends the worker; the command at hand is cancelled where that is possible."""
        with self._wake:
            self._stopping = True
            self._wake.notify_all()

    def _cancel(self) -> None:
        if self._can_cancel and not self._cancelled:
            self._queue.clear()
            self._on_cancel()
            self._cancelled = True


# While something else is made ready, people may look around in what is open.


class Cancellation:
    """What the worker does besides a command that takes long, each time it is asked whether that is still wanted.

    Args:
        requests: where people ask for things.
        look_around: carries out a command that only looks, and shows it.
    """

    def __init__(self, requests: RequestQueue, look_around: Callable[[Command], None]) -> None:
        self._requests, self._look_around = requests, look_around
        self._worker: int | None = None
        """The thread that may look around; None = nothing takes long, or it looks around already."""

    @contextmanager
    def cancellable(self, command: object) -> Iterator[None]:
        """What the worker does inside may be cancelled; where it is long, commands that only look go on meanwhile."""
        is_long = isinstance(command, Command) and command.is_long
        self._worker = threading.get_ident() if is_long else None
        try:
            with self._requests.cancellable():
                yield
        finally:
            self._worker = None

    def is_wanted(self) -> bool:
        """Whether what the worker is at is still wanted."""
        if self._worker == threading.get_ident():
            worker, self._worker = self._worker, None
            while (command := self._requests.take_looking()) is not None:
                self._look_around(command)
            self._worker = worker
        return self._requests.are_wanted
