"""Arrow batches of a known schema as bytes: all but counts and contents is the same every time.

Arrow's own way from arrays to an IPC stream takes a dozen objects a batch, more than most batches of a recording take
to fill. Here Arrow writes an example of each kind of batch once; its counts are then overwritten. An IPC stream is
the schema, the batch, the end; the head of a batch is a flatbuffer that holds the number of rows, a length and a
number of nulls for every array in it (depth first), and place and length of every buffer in the body.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from itertools import accumulate, chain, repeat

import pyarrow as pa

_END = b"\xff\xff\xff\xff\0\0\0\0"
_PREFIX = struct.Struct("<iI")
"""Before every message of a stream: -1, then the length of its head."""
_NUMBER = struct.Struct("<q")
_ALIGNED = 8


class Form:
    """Batches of one schema."""

    def __init__(self, schema: pa.Schema, chunk_id: bytes) -> None:
        """
        Args:
            schema: of all the batches.
            chunk_id: occurs once in the schema's metadata; another stands there in each batch.
        """
        before, found, after = schema.serialize().to_pybytes().partition(chunk_id)
        if not found:
            raise ValueError("the schema does not hold the chunk's id")
        example: pa.RecordBatch = pa.RecordBatch.from_arrays([pa.nulls(1, f.type) for f in schema], schema=schema)
        self._before, self._after = before, after
        self._head = _head(example.serialize().to_pybytes())
        self._at = _Places(self._head)

    def stream(self, chunk_id: bytes, n_rows: int, nodes: Sequence[int], buffers: Sequence[bytes]) -> bytes:
        """A batch as an IPC stream.

        Args:
            chunk_id: as long as the one of the example.
            n_rows: of every column.
            nodes: length and number of nulls of every array, depth first.
            buffers: of every array, depth first; empty where there are no nulls to tell apart.

        Raises:
            struct.error: there are more or fewer of them than the schema has.
        """
        head, at = bytearray(self._head), self._at
        lengths = list(map(len, buffers))
        taken = [n + -n % _ALIGNED for n in lengths]
        starts = list(accumulate(taken, initial=0))
        _NUMBER.pack_into(head, at.n_rows, n_rows)
        _NUMBER.pack_into(head, at.body_size, starts[-1])
        at.nodes.pack_into(head, at.first_node, *nodes)
        # The last start is the end of all.
        at.buffers.pack_into(head, at.first_buffer, *chain.from_iterable(zip(starts, lengths, strict=False)))
        aligned = map(bytes.ljust, buffers, taken, repeat(b"\0"))
        return b"".join((self._before, chunk_id, self._after, head, *aligned, _END))


def parts(array: pa.Array) -> tuple[list[int], list[bytes]]:
    """Nodes and buffers of an array, as :meth:`Form.stream` takes them."""
    message = pa.RecordBatch.from_arrays([array], names=[""]).serialize().to_pybytes()
    head = _head(message)
    at, body = _Places(head), message[len(head) :]
    places = at.buffers.unpack_from(head, at.first_buffer)
    nodes = list(at.nodes.unpack_from(head, at.first_node))
    return nodes, [body[start : start + n] for start, n in zip(places[::2], places[1::2], strict=True)]


class _Places:
    """Where the counts stand in the head of a batch."""

    def __init__(self, head: bytes | bytearray) -> None:
        message = _fields(head, _PREFIX.size + _offset(head, _PREFIX.size))
        batch = _fields(head, message[2] + _offset(head, message[2]))
        self.body_size, self.n_rows = message[3], batch[0]
        self.first_node, n_nodes = _vector(head, batch[1])
        self.first_buffer, n_buffers = _vector(head, batch[2])
        self.nodes, self.buffers = struct.Struct(f"<{2 * n_nodes}q"), struct.Struct(f"<{2 * n_buffers}q")


def _head(message: bytes) -> bytes:
    """The message without its body."""
    _, length = _PREFIX.unpack_from(message)
    return message[: _PREFIX.size + length]


def _fields(head: bytes | bytearray, table: int) -> list[int]:
    """Where each field of a flatbuffer's table stands; 0 for one that it leaves out."""
    at = table - struct.unpack_from("<i", head, table)[0]
    (size,) = struct.unpack_from("<H", head, at)
    return [table + n if n else 0 for n in struct.unpack_from(f"<{(size - 4) // 2}H", head, at + 4)]


def _vector(head: bytes | bytearray, field: int) -> tuple[int, int]:
    """Where the elements of a vector begin, and how many there are."""
    at = field + _offset(head, field)
    return at + 4, _offset(head, at)


def _offset(head: bytes | bytearray, at: int) -> int:
    return struct.unpack_from("<I", head, at)[0]
