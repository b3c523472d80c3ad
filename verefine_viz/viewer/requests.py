"""What was asked for and is not done yet: any thread may ask, one worker takes."""

from __future__ import annotations

import threading
from collections import deque

from verefine_viz.viewer.command import Command

STOP = object()
"""What the worker takes instead of a command when it is to end."""


class Requests:
    """The queue between the page, or a script, and the worker."""

    def __init__(self) -> None:
        self._queue: deque[Command] = deque()
        self._wake = threading.Condition()
        self._stopping = False
        self._idle = False

    def send(self, command: Command) -> None:
        """Puts a command into the queue; returns at once."""
        with self._wake:
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
        """Ends the worker after the command at hand."""
        with self._wake:
            self._stopping = True
            self._wake.notify_all()
