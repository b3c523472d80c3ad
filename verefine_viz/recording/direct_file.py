"""A recording written by whoever draws it, without a thread: what is cheap to draw costs less than handing it over.

rerun encodes chunks in memory; its messages are then appended to the file as they are, as described in ``rrd_file``.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import rerun as rr
from rerun.chunk import Chunk

from verefine_viz.core.errors import InputError
from verefine_viz.recording.entities import APPLICATION
from verefine_viz.recording.rrd_file import head, messages


class DirectFile:
    """Writes chunks to a file; they are in it when :meth:`send` returns."""

    def __init__(self, path: Path) -> None:
        """Creates the file.

        Raises:
            OSError: it cannot be written.
        """
        self._path = path
        self._file = path.open("wb", buffering=0)
        self._stream = rr.RecordingStream(APPLICATION, send_properties=False)
        self._stream.set_log_time_enabled(False)
        self._encoded = self._stream.binary_stream()
        self._is_begun = False
        self._error = ""

    def send(self, chunks: Iterable[Chunk]) -> None:
        """Writes chunks.

        Raises:
            InputError: the disk does not take them, or did not take what came before.
        """
        self._stream.send_chunks(list(chunks))
        content = self._encoded.read() or b""
        self._write(messages(content) if self._is_begun else head(content) + messages(content))
        self._is_begun = True

    def flush(self) -> None:
        """Nothing waits here."""

    def close(self, blueprint: bytes) -> None:
        """Adds the messages of a blueprint.

        Raises:
            InputError: the disk does not take them.
        """
        try:
            self._write(blueprint)
        finally:
            self._file.close()
            self._stream.disconnect()

    def _write(self, content: bytes) -> None:
        if self._error:
            raise InputError(self._error)
        try:
            rest = memoryview(content)
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._error = f"cannot write the recording {self._path}: {error.strerror}"
            self._file.close()
            raise InputError(self._error) from None
