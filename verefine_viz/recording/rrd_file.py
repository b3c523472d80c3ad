"""Recordings as files: chunks go in while they are made, the blueprint at the end.

rerun writes the chunks (:meth:`LazyChunkStream.write_rrd`), in a thread of its own that needs the interpreter only to
ask for the next one, and each is on disk before that. What rerun has no call for is to add a blueprint to such a file.
An .rrd file is a head of 12 bytes and then messages, each after its kind and its length (8 bytes each, little-endian);
messages of a recording and of a blueprint follow one another in any order. So a blueprint that was made once is copied
into every file that needs it. It takes the place of the footer, an index of the chunks, which must not be there when it
does not know the blueprint; rerun reads files without one from beginning to end.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Thread
from uuid import uuid4

from rerun.chunk import Chunk, LazyChunkStream

from verefine_viz.core.errors import InputError
from verefine_viz.recording.entities import APPLICATION

HEAD = b"RRF2"
_HEAD_SIZE = 12
_MESSAGE = struct.Struct("<QQ")
_END = 0
"""Kind of the message that holds the footer."""
_TAIL = struct.Struct("<QQI8sI")
"""After the last message: where the footer begins, how long it is, its checksum, a mark, how many footers."""
_MARK = b"RRF2FOOT"


class RrdFile:
    """Writes chunks to a file beside the caller; each gets there as soon as it is made."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._waiting: SimpleQueue[Iterable[Chunk] | None] = SimpleQueue()
        self._error: Exception | None = None
        # If nobody closes it, the process must still be able to end.
        self._thread = Thread(target=self._write, name="recording", daemon=True)
        self._thread.start()

    def send(self, chunks: Iterable[Chunk]) -> None:
        """Hands over chunks; a generator is run in the writing thread.

        Raises:
            InputError: what was sent before could not be written.
        """
        self._check()
        self._waiting.put(chunks)

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
        self._check()
        try:
            _end_with(self._path, blueprint)
        except OSError as error:
            raise InputError(f"cannot write the recording {self._path}: {error.strerror}") from None

    def _check(self) -> None:
        """Raises what went wrong in the thread: a fault of the disk in one line, a fault of ours as it is."""
        error = self._error
        if isinstance(error, OSError | RuntimeError):
            reason = next(iter(str(error).splitlines()), type(error).__name__)
            raise InputError(f"cannot write the recording {self._path}: {reason}") from None
        if error is not None:
            raise error

    def _write(self) -> None:
        try:
            stream = LazyChunkStream.from_iter(self._chunks())
            stream.write_rrd(self._path, application_id=APPLICATION, recording_id=uuid4().hex)
        except Exception as error:
            self._error = self._error or error

    def _chunks(self) -> Iterator[Chunk]:
        try:
            while (chunks := self._waiting.get()) is not None:
                yield from chunks
        except Exception as error:
            self._error = error  # rerun would tell of it in its own words
            raise


def _signal(reached: Event) -> Iterator[Chunk]:
    """No chunk; says that those before it were asked for and written."""
    reached.set()
    yield from ()


def head(content: bytes) -> bytes:
    """How an .rrd file begins.

    Raises:
        ValueError: it is no such file.
    """
    if not content.startswith(HEAD):
        raise ValueError("not an .rrd file")
    return content[:_HEAD_SIZE]


def messages(content: bytes) -> bytes:
    """All messages of an .rrd file but its footer.

    Raises:
        ValueError: it is no such file.
    """
    if not content.startswith(HEAD):
        raise ValueError("not an .rrd file")
    at = _HEAD_SIZE
    while at + _MESSAGE.size <= len(content):
        kind, length = _MESSAGE.unpack_from(content, at)
        if kind == _END:
            break
        at += _MESSAGE.size + length
    return content[_HEAD_SIZE:at]


def _end_with(path: Path, blueprint: bytes) -> None:
    """Puts messages in the place of the footer of a finished file."""
    with path.open("r+b") as file:
        file.seek(-_TAIL.size, 2)
        footer_at, _, _, mark, _ = _TAIL.unpack(file.read(_TAIL.size))
        if mark != _MARK:
            raise OSError(0, "rerun ends its files in another way than this version expects")
        file.seek(footer_at - _MESSAGE.size)
        file.write(blueprint)
        file.truncate()
