"""What a recording is made of: chunks as Arrow batches, each encoded once for all recordings that hold it.

rerun's own way from arrays to a file (``Chunk``, then ``RecordingStream``) takes 0.3 ms a chunk, more than most chunks
here take to draw. An .rrd file is a head and then messages: kind and length (8 bytes each, little-endian), then a
protobuf. That of a chunk (``ArrowMsg``) names the recording and holds the batch as an Arrow IPC stream, packed with
LZ4. What is not about the layout of files, above all what columns of a chunk look like, is asked of rerun itself.
"""

from __future__ import annotations

import itertools
import random
import struct
import time
from functools import cache, cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk

from verefine_viz.recording.entities import APPLICATION

_HEAD_SIZE = 12
_MESSAGE = struct.Struct("<QQ")
_BEGIN, _CHUNK = 1, 2
"""Kinds of messages."""
_LZ4, _ARROW_IPC = 2, 1
_MOST_ROWS = 1 << 24
_IDS = itertools.count(random.getrandbits(62), _MOST_ROWS)
"""Lower halves of ids: random first, then rising, with room for the rows of a chunk in between."""


class Piece:
    """One chunk."""

    def __init__(self, batch: pa.RecordBatch) -> None:
        """
        Args:
            batch: as ``Chunk.to_record_batch`` has it.
        """
        self.batch = batch

    @property
    def chunks(self) -> list[Chunk]:
        """The same for rerun's own calls."""
        return Chunk.from_record_batch(self.batch)

    @cached_property
    def body(self) -> bytes:
        """Its message, without the recording that it belongs to."""
        schema: Any = self.batch.schema
        # An IPC stream: the schema, the batch, the end.
        content = b"".join((schema.serialize(), self.batch.serialize(), b"\xff\xff\xff\xff\0\0\0\0"))
        packed = _lz4().compress(content, asbytes=True)
        chunk_id = schema.metadata[b"rerun:id"].rpartition(b"_")[2]
        first, second = int(chunk_id[:16], 16), int(chunk_id[16:], 16)
        is_static = len(schema) < 2 or schema.field(1).metadata[b"rerun:kind"] != b"index"
        return b"".join(
            (
                b"\x10%c\x18%b\x20%c" % (_LZ4, _varint(len(content)), _ARROW_IPC),
                b"\x2a" + _varint(len(packed)),
                packed,
                struct.pack("<BBBQBQ", 0x32, 18, 0x09, first, 0x11, second),
                b"\x38%c" % is_static,
            )
        )


class Store:
    """Which recording messages belong to."""

    def __init__(self, recording_id: str) -> None:
        """
        Args:
            recording_id: 32 characters.
        """
        application = b"\x0a" + _sized(APPLICATION.encode())
        store = b"\x08\x01\x12" + _sized(recording_id.encode()) + b"\x1a" + _sized(application)
        self._id = b"\x0a" + _sized(store)
        self._recording_id = recording_id

    def begin(self) -> bytes:
        """How its file begins."""
        return _beginning().replace(_NO_ID.encode(), self._recording_id.encode())

    def message(self, piece: Piece) -> bytes:
        """A chunk of it."""
        body = piece.body
        return b"".join((_MESSAGE.pack(_CHUNK, len(self._id) + len(body)), self._id, body))


def new_ids(n: int) -> tuple[bytes, pa.FixedSizeBinaryArray]:
    """The id of a chunk with ``n`` rows, and theirs."""
    now, first = time.time_ns(), next(_IDS)
    ids = np.empty((n, 2), ">u8")
    ids[:, 0], ids[:, 1] = now, np.arange(first + 1, first + 1 + n, dtype=np.uint64)
    rows = pa.FixedSizeBinaryArray.from_buffers(_ROW_ID, n, [None, pa.py_buffer(ids)])
    return b"chunk_%016X%016x" % (now, first), rows


_ROW_ID = pa.binary(16)


_NO_ID = "0" * 32


@cache
def _beginning() -> bytes:
    """Head and first message of a recording called ``_NO_ID``, by rerun."""
    stream = rr.RecordingStream(APPLICATION, recording_id=_NO_ID, send_properties=False)
    content = stream.binary_stream().read() or b""
    stream.disconnect()
    kind, length = _MESSAGE.unpack_from(content, _HEAD_SIZE)
    if kind != _BEGIN:
        raise RuntimeError("rerun begins its files in another way than this version expects")
    return content[: _HEAD_SIZE + _MESSAGE.size + length]


@cache
def _lz4() -> pa.Codec:
    return pa.Codec("lz4_raw")


def _sized(content: bytes) -> bytes:
    return _varint(len(content)) + content


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    out.append(number)
    return bytes(out)
