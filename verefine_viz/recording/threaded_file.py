"""A file that is written beside the run: most of the work on pictures does not need the interpreter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from queue import SimpleQueue
from threading import Event, Thread

from verefine_viz.recording.piece import Piece
from verefine_viz.recording.rrd_file import RrdFile


class ThreadedFile:
    """Hands chunks to a file in a thread of its own."""

    def __init__(self, file: RrdFile) -> None:
        self._file = file
        self._waiting: SimpleQueue[Iterable[Piece] | None] = SimpleQueue()
        self._error: Exception | None = None
        # If nobody closes it, the process must still be able to end.
        self._thread = Thread(target=self._write, name="recording", daemon=True)
        self._thread.start()

    def send(self, pieces: Iterable[Piece]) -> None:
        """Hands over chunks; a generator is run in the writing thread.

        Raises:
            InputError: what was sent before could not be written.
        """
        self._check()
        self._waiting.put(pieces)

    def flush(self) -> None:
        """Waits until what was sent is in the file.

        Raises:
            InputError: it could not be written.
        """
        reached = Event()
        self._waiting.put(_signal(reached))
        while not reached.wait(0.05):
            self._check()

    def close(self, blueprint: bytes) -> None:
        """Waits until everything is written, and adds the messages of a blueprint.

        Raises:
            InputError: it could not be written.
        """
        self._waiting.put(None)
        self._thread.join()
        try:
            self._check()
        finally:
            self._file.close(blueprint)

    def _check(self) -> None:
        if self._error is not None:
            raise self._error

    def _write(self) -> None:
        try:
            while (pieces := self._waiting.get()) is not None:
                for piece in pieces:
                    self._file.send([piece])
        except Exception as error:
            self._error = error


def _signal(reached: Event) -> Iterator[Piece]:
    """No chunk; says that those before it were asked for and written."""
    reached.set()
    yield from ()
