"""Recordings as files: what is sent is in the file when the call returns; the blueprint follows at the end."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from uuid import uuid4

from verefine_viz.core.errors import InputError
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.rrd_messages import Store


class RrdFile:
    """Writes chunks to a file."""

    def __init__(self, path: Path) -> None:
        """Creates the file.

        Raises:
            OSError: it cannot be written.
        """
        self._path = path
        self._file = path.open("wb", buffering=0)
        self._store = Store(uuid4().hex)
        self._error = ""
        self._write(self._store.begin())

    def send(self, pieces: Iterable[Piece]) -> None:
        """Writes chunks.

        Raises:
            InputError: the disk does not take them, or did not take what came before.
        """
        self._write(self._store.messages(piece.body for piece in pieces))

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
