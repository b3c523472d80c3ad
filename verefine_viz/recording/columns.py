"""Arrow columns and chunks for rerun, made from plain arrays in one go.

Building the lists here, instead of through one archetype per row, is what keeps a recording cheap. How a column is
called and described in a chunk is learnt from rerun, once for each kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import ArrayLike, NDArray
from rerun.chunk import Chunk

from verefine_viz.recording.entities import TIMELINE
from verefine_viz.recording.piece import Piece, new_ids

Rows: TypeAlias = Sequence[ArrayLike] | NDArray[Any]


@dataclass(frozen=True)
class Column:
    """One component over many rows: element i of ``rows`` is the list that row i holds."""

    descriptor: rr.ComponentDescriptor
    rows: pa.ListArray

    def component_descriptor(self) -> rr.ComponentDescriptor:
        return self.descriptor

    def as_arrow_array(self) -> pa.Array:
        return self.rows


def rows_of(entity: str, iterations: Sequence[int], columns: Sequence[Column]) -> Piece:
    """Rows of ``entity`` at ``iterations``, which must not fall, as one chunk."""
    times = np.array(iterations, np.int64)
    if (np.diff(times) < 0).any():
        raise ValueError(f"iterations of {entity} are not in order")
    return _piece(entity, [pa.array(times)], columns)


def at(entity: str, iteration: int, *archetypes: rr.AsComponents) -> Piece:
    """Archetypes at one iteration, as a chunk."""
    return rows_of(entity, [iteration], _parts(archetypes))


def fixed(entity: str, *archetypes: rr.AsComponents) -> Piece:
    """What does not change over time, as a chunk that can be sent to any number of recordings."""
    return _piece(entity, [], _parts(archetypes))


def _piece(entity: str, times: list[pa.Array], columns: Sequence[Column]) -> Piece:
    n_rows = len(columns[0].rows)
    chunk_id, row_ids = new_ids(n_rows)
    before = _before(bool(times))
    fields = [_field(_Kind(c.descriptor), c.rows.type) for c in columns]
    metadata = {**before.metadata, b"rerun:entity_path": entity.encode(), b"rerun:id": chunk_id}
    schema = pa.schema([*before, *fields], metadata)
    return Piece(pa.RecordBatch.from_arrays([row_ids, *times, *(c.rows for c in columns)], schema=schema))


class _Kind:
    """A descriptor by what it says."""

    def __init__(self, descriptor: rr.ComponentDescriptor) -> None:
        self.descriptor = descriptor
        self._key = (descriptor.archetype, descriptor.component, descriptor.component_type)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Kind) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@lru_cache(maxsize=256)
def _field(kind: _Kind, layout: pa.DataType) -> pa.Field:
    """How rerun calls and describes a column."""
    example: Any = Column(kind.descriptor, pa.nulls(1, layout))
    found: Any = Chunk.from_columns("/", [], [example]).to_record_batch().schema
    return found.field(1)


@cache
def _before(is_timed: bool) -> pa.Schema:
    """The columns before those of the components, and what rerun says about every chunk."""
    example: Any = Column(rr.Scalars.descriptor_scalars(), pa.array([[0.0], [0.0]]))
    times = [rr.TimeColumn(TIMELINE, sequence=[0, 0])] if is_timed else []
    found: Any = Chunk.from_columns("/", times, [example]).to_record_batch().schema
    return pa.schema(list(found)[:-1], found.metadata)


def _parts(archetypes: Sequence[rr.AsComponents]) -> list[Column]:
    batches = [batch for archetype in archetypes for batch in archetype.as_component_batches()]
    return [_single(b.component_descriptor(), b.as_arrow_array()) for b in batches]


def _single(descriptor: rr.ComponentDescriptor, row: pa.Array) -> Column:
    return Column(descriptor, pa.ListArray.from_arrays(pa.array([0, len(row)], pa.int32()), row))


def numbers(descriptor: rr.ComponentDescriptor, rows: Rows, dtype: Any = np.float64) -> Column:
    """Rows of numbers, each of any length."""
    lengths, values = _flat(rows, dtype, 1)
    return Column(descriptor, pa.ListArray.from_arrays(_offsets(lengths), pa.array(values)))


def vectors(descriptor: rr.ComponentDescriptor, rows: Rows, width: int) -> Column:
    """Rows of float32 vectors (n, width), each row of any n."""
    lengths, values = _flat(rows, np.float32, width)
    return Column(descriptor, pa.ListArray.from_arrays(_offsets(lengths), _fixed_width(values, width)))


def strips(descriptor: rr.ComponentDescriptor, rows: Rows) -> Column:
    """Rows of one line strip (n, 3) each; an empty strip is a row without one."""
    lengths, values = _flat(rows, np.float32, 3)
    points = _fixed_width(values, 3)
    field = pa.field("item", points.type, nullable=False)
    strip = pa.ListArray.from_arrays(_offsets([n for n in lengths if n]), points, type=pa.list_(field))
    return Column(descriptor, pa.ListArray.from_arrays(_offsets([min(n, 1) for n in lengths]), strip))


def texts(descriptor: rr.ComponentDescriptor, rows: Sequence[Sequence[str]]) -> Column:
    """Rows of texts, each of any length."""
    flat = pa.array([text for row in rows for text in row], pa.string())
    return Column(descriptor, pa.ListArray.from_arrays(_offsets([len(row) for row in rows]), flat))


def bars(descriptor: rr.ComponentDescriptor, rows: Rows) -> Column:
    """Rows of one bar chart each: a tensor of one dimension."""
    layout = _tensor_type()
    lengths, numbers_ = _flat(rows, np.float64, 1)
    shape_type, buffer_type = layout.field("shape").type, layout.field("buffer").type
    shapes = pa.array([[n] for n in lengths], pa.list_(pa.uint64())).cast(shape_type)
    names = pa.nulls(len(lengths), layout.field("names").type)
    codes = [buffer_type.field(i).name for i in range(buffer_type.num_fields)]
    children = [pa.array([], buffer_type.field(i).type) for i in range(len(codes))]
    at = codes.index("F64")
    item = buffer_type.field(at).type
    children[at] = pa.ListArray.from_arrays(_offsets(lengths), pa.array(numbers_), type=item)
    kinds, places = np.full(len(lengths), at, np.int8), np.arange(len(lengths), dtype=np.int32)
    parts = [None, pa.py_buffer(kinds.tobytes()), pa.py_buffer(places.tobytes())]
    union = pa.Array.from_buffers(buffer_type, len(lengths), parts, children=children)
    values = pa.StructArray.from_arrays([shapes, names, union], fields=list(layout))
    return Column(descriptor, pa.ListArray.from_arrays(pa.array(np.arange(len(lengths) + 1, dtype=np.int32)), values))


@cache
def _tensor_type() -> pa.StructType:
    example = rr.BarChart(np.zeros(1)).values
    assert example is not None
    return example.as_arrow_array().type


def _flat(rows: Rows, dtype: Any, width: int) -> tuple[list[int], NDArray[Any]]:
    """How many elements of ``width`` numbers each row has, and all numbers one after another."""
    if isinstance(rows, np.ndarray):
        n = rows[0].size // width if len(rows) else 0
        return [n] * len(rows), np.ascontiguousarray(rows, dtype).ravel()
    flat = [np.asarray(row, dtype).ravel() for row in rows]
    return [len(f) // width for f in flat], np.concatenate(flat) if flat else np.zeros(0, dtype)


def _offsets(lengths: Sequence[int]) -> pa.Array:
    # Arrow reads a numpy array as it is, a list item by item.
    return pa.array(np.array(list(accumulate(lengths, initial=0)), np.int32))


def _fixed_width(values: NDArray[np.float32], width: int) -> pa.FixedSizeListArray:
    # rerun's own schema says that neither vectors nor their elements can be missing.
    layout = pa.list_(pa.field("item", pa.float32(), nullable=False), width)
    return pa.FixedSizeListArray.from_arrays(pa.array(values), type=layout)
