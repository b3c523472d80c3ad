"""What a recording is made of: chunks, each made once for all recordings that hold it.

rerun's own way from arrays to a file (``Chunk``, then ``RecordingStream``) takes 0.3 ms a chunk, more than most chunks
here take to draw.
"""

from __future__ import annotations

import itertools
import random
import time
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk

from verefine_viz.recording.rrd_messages import chunk_body

_MOST_ROWS = 1 << 24
_IDS = itertools.count(random.getrandbits(62), _MOST_ROWS)
"""Lower halves of ids: random first, then rising, with room for the rows of a chunk in between."""


class Piece:
    """One chunk."""

    def __init__(self, chunk_id: tuple[int, int], is_static: bool, stream: bytes) -> None:
        """
        Args:
            chunk_id: both halves.
            is_static: whether it has no time.
            stream: as an Arrow IPC stream of one batch.
        """
        self._chunk_id = chunk_id
        self._is_static = is_static
        self._stream = stream

    @staticmethod
    def of(chunk: Chunk) -> Piece:
        """A chunk of rerun's."""
        batch: Any = chunk.to_record_batch()
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, batch.schema) as writer:
            writer.write_batch(batch)
        name = batch.schema.metadata[b"rerun:id"].rpartition(b"_")[2]
        return Piece((int(name[:16], 16), int(name[16:], 16)), chunk.is_static, sink.getvalue().to_pybytes())

    @cached_property
    def body(self) -> bytes:
        """Its message in a file, without the recording that it belongs to."""
        return chunk_body(self._chunk_id, self._is_static, self._stream)

    @property
    def chunks(self) -> list[Chunk]:
        """The same for rerun's own calls."""
        return Chunk.from_record_batch(self.batch)

    @property
    def batch(self) -> pa.RecordBatch:
        return pa.ipc.open_stream(self._stream).read_next_batch()


def new_ids(n: int) -> tuple[tuple[int, int], bytes]:
    """The id of a chunk with ``n`` rows, and theirs."""
    now, first = time.time_ns(), next(_IDS)
    ids = np.empty((n, 2), np.uint64)
    ids[:, 0], ids[:, 1] = now, np.arange(first + 1, first + 1 + n)
    # The highest byte comes first.
    return (now, first), ids.astype(">u8").tobytes()
