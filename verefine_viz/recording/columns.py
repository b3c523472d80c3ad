"""Arrow columns and chunks for rerun, made from plain arrays in one go.

A chunk takes anything that has a descriptor and an Arrow array. Building the lists here, instead of through one
archetype per row, is what keeps a recording cheap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import ArrayLike, NDArray
from rerun.chunk import Chunk

from verefine_viz.recording.entities import TIMELINE

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


def rows_of(entity: str, iterations: Sequence[int], columns: Sequence[Any]) -> Chunk:
    """Rows of ``entity`` at ``iterations`` as one chunk."""
    return Chunk.from_columns(entity, [rr.TimeColumn(TIMELINE, sequence=iterations)], columns)


def at(entity: str, iteration: int, *archetypes: rr.AsComponents) -> Chunk:
    """Archetypes at one iteration, as a chunk."""
    return Chunk.from_columns(entity, [rr.TimeColumn(TIMELINE, sequence=[iteration])], _parts(archetypes))


def fixed(entity: str, *archetypes: rr.AsComponents) -> Chunk:
    """What does not change over time, as a chunk that can be sent to any number of recordings."""
    return Chunk.from_columns(entity, [], _parts(archetypes))


def _parts(archetypes: Sequence[rr.AsComponents]) -> list[Any]:
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
