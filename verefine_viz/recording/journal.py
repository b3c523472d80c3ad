"""The journal: a small file beside a recording that is being written, one entry per iteration, never rewritten.

Handing an iteration to rerun and waiting until it is on disk costs 0.3 ms and 1 kB of overhead; an entry here costs a
tenth. So rows reach the disk one by one here, rerun gets them in blocks, and whoever opens a recording whose writer was
killed has them all. The journal is removed when the recording is complete.

An entry is its length, the length of its head and its CRC-32 (4 bytes each, little-endian), then the head, which is
JSON and names the arrays, then the arrays.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import fields
from pathlib import Path

import numpy as np

from verefine_viz.recording.row import Row

MAGIC = b"VRFJ1\n"
_FRAME = struct.Struct("<III")


class Journal:
    """Appends rows; each is with the operating system when :meth:`append` returns."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("wb", buffering=0)
        self._file.write(MAGIC)

    def append(self, row: Row) -> None:
        self._file.write(encode(row))

    def close(self) -> None:
        self._file.close()

    def remove(self) -> None:
        """Close and delete: the recording beside it is complete."""
        self.close()
        self._path.unlink(missing_ok=True)


def encode(row: Row) -> bytes:
    """One entry."""
    head: dict[str, object] = {}
    blocks: list[bytes] = []
    for name in _NAMES:
        value = getattr(row, name)
        if isinstance(value, np.ndarray):
            head[name] = [value.dtype.str, value.shape]
            blocks.append(value.tobytes())
        else:
            head[name] = value
    text = _to_json(head).encode()
    body = b"".join([text, *blocks])
    return _FRAME.pack(len(body), len(text), zlib.crc32(body)) + body


def read_journal(path: Path) -> tuple[Row, ...]:
    """All whole entries of a journal; what was cut off in the middle of the last one is left out."""
    content = path.read_bytes()
    if not content.startswith(MAGIC):
        return ()
    rows: list[Row] = []
    at = len(MAGIC)
    while at + _FRAME.size <= len(content):
        length, text_length, crc = _FRAME.unpack_from(content, at)
        body = content[at + _FRAME.size : at + _FRAME.size + length]
        if len(body) < length or zlib.crc32(body) != crc:
            break
        rows.append(_decode(body, text_length))
        at += _FRAME.size + length
    return tuple(rows)


def _decode(body: bytes, text_length: int) -> Row:
    head = json.loads(body[:text_length])
    at = text_length
    values: dict[str, object] = {}
    for name in _NAMES:
        value = head[name]
        if name in _ARRAYS:
            dtype, shape = np.dtype(value[0]), tuple(value[1])
            n = int(np.prod(shape))
            values[name] = np.frombuffer(body, dtype, n, at).reshape(shape)
            at += n * dtype.itemsize
        else:
            values[name] = tuple(value) if isinstance(value, list) else value
    return Row(**values)  # type: ignore[arg-type]


_to_json = json.JSONEncoder(separators=(",", ":")).encode
_NAMES = tuple(f.name for f in fields(Row))
_ARRAYS = {"Ts_cam_obj", "scores", "pixels", "T_best", "best_score", "best_pixels", "path", "contacts", "choice"}
_ARRAYS |= {"errors", "ms"}
