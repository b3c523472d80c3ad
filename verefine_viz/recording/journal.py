"""The journal: a small file beside a recording that is being written, one entry per iteration, never rewritten.

The recording itself is made in large pieces, beside the run. Iterations reach the disk one by one here, and whoever
opens a recording whose writer was killed has them all. The journal is removed when the recording is complete.

It begins with what the recording is about (JSON). An entry is its length and its CRC-32 (4 bytes each, little-endian),
then the iteration and its errors as msgpack, field by field as in ``core.records``.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin

import cattrs
import numpy as np
import ormsgpack

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.records import Contacts, Iteration
from verefine_viz.recording.row import Row, rows_of

MAGIC = b"VRFJ4\n"
_FRAME = struct.Struct("<II")


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
        self._write(MAGIC + _framed(json.dumps(about).encode()))

    def append(self, iteration: Iteration, errors: Float) -> None:
        """
        Args:
            iteration: what happened.
            errors: what ``Row.errors`` says.

        Raises:
            InputError: the disk does not take it.
        """
        self._write(encode(iteration, errors))

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


def encode(iteration: Iteration, errors: Float) -> bytes:
    """One entry. The run waits for this, so everything goes as it is; rows are made where they are drawn."""
    return _framed(ormsgpack.packb((iteration, errors), np.ndarray.tolist, ormsgpack.OPT_SERIALIZE_NUMPY))


def read_journal(path: Path) -> tuple[dict[str, Any], tuple[Row, ...]]:
    """What the journal is about and all its whole entries.

    What was cut off in the middle of the last entry is left out; nothing is known of a file that is no journal.
    """
    content = path.read_bytes()
    found = _whole_entries(content) if content.startswith(MAGIC) else []
    about, *entries = found or [b"{}"]
    return json.loads(about), tuple(rows_of([_decode(entry) for entry in entries]))


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


def _decode(entry: bytes) -> tuple[Iteration, Float]:
    iteration, errors = ormsgpack.unpackb(entry)
    return _converter().structure(iteration, Iteration), np.array(errors, np.float64)


@cache
def _converter() -> cattrs.Converter:
    """From plain values to records."""
    converter = cattrs.Converter()
    converter.register_structure_hook_func(lambda kind: get_origin(kind) is np.ndarray, _array)
    converter.register_structure_hook(Contacts, _contacts)
    return converter


def _array(values: Any, kind: Any) -> np.ndarray:
    """As its annotation says: ``NDArray[np.float64]`` is an array of any shape and of that type."""
    _, dtype = get_args(kind)
    return np.array(values, get_args(dtype)[0])


def _contacts(values: Mapping[str, Any], _: Any) -> Contacts:
    """Plain values do not say how wide an empty array is."""
    return Contacts(
        np.reshape(values["points_cam"], (-1, 3)),
        np.reshape(values["normals_cam"], (-1, 3)),
        values["depths_m"],
        values["forces_n"],
        values["others"],
    )
