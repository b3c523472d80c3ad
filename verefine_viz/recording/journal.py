"""The journal: a small file beside a recording that is being written, one entry per iteration, never rewritten.

The recording itself is made in large pieces, beside the run. Iterations reach the disk one by one here, and whoever
opens a recording whose writer was killed has them all. The journal is removed when the recording is complete.

It begins with what the recording is about (msgpack). An entry is its length and its CRC-32 (4 bytes each,
little-endian), then its bytes.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import ormsgpack

from verefine_viz.core.errors import InputError
from verefine_viz.core.input_files import read_input
from verefine_viz.recording.entry import Entry

MAGIC = b"VRFJ5\n"
_FRAME = struct.Struct("<II")
_NOTHING = ormsgpack.packb({})


class Journal:
    """Appends iterations; each is with the operating system when :meth:`append` returns."""

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        """
        Raises:
            OSError: the file cannot be created.
            InputError: the disk does not take its beginning.
        """
        self._path = path
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._write(MAGIC + _framed(ormsgpack.packb(dict(about))))

    def append(self, entry: Entry) -> None:
        """
        Raises:
            InputError: the disk does not take it.
        """
        self._write(_framed(entry.packed))

    def close(self) -> None:
        """Later calls do nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _write(self, content: bytes) -> None:
        try:
            # A disk that is nearly full takes a part, and refuses when it is asked again.
            while content:
                content = content[os.write(self._file, content) :]
        except OSError as error:
            raise InputError(f"cannot write {self._path}: {error.strerror or error}") from None


def read_journal(path: Path) -> tuple[dict[str, Any], tuple[Entry, ...]]:
    """What the journal is about and all its whole entries.

    What was cut off in the middle of the last entry is left out; nothing is known of a file that is no journal.

    Raises:
        InputError: it cannot be read, or holds something else than iterations.
    """
    content = read_input(path, "journal")
    found = _whole_entries(content) if content.startswith(MAGIC) else []
    head, *packed = found or [_NOTHING]
    try:
        about: object = ormsgpack.unpackb(head)
        if not isinstance(about, dict):
            raise ValueError("it does not begin with what the run is about")
        return about, tuple(map(Entry.read, packed))
    except ValueError as error:
        raise InputError(f"journal {path} is damaged: {error}; run its session again") from None


def _framed(body: bytes) -> bytes:
    return _FRAME.pack(len(body), zlib.crc32(body)) + body


def _whole_entries(content: bytes) -> list[bytes]:
    found: list[bytes] = []
    at = len(MAGIC)
    while at + _FRAME.size <= len(content):
        length, crc = _FRAME.unpack_from(content, at)
        body = content[at + _FRAME.size : at + _FRAME.size + length]
        if len(body) < length or zlib.crc32(body) != crc:
            break
        found.append(body)
        at += _FRAME.size + length
    return found
