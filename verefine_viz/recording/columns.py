"""Arrow columns for rerun, made from plain arrays in one go.

``rr.send_columns`` takes anything that has a descriptor and an Arrow array. Building the lists here, instead of through
one archetype per row, is what keeps a recording cheap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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


def send(rec: rr.RecordingStream, entity: str, iterations: Sequence[int], columns: Sequence[Any]) -> None:
    """Rows of ``entity`` at ``iterations`` as one chunk."""
    rec.send_columns(entity, [rr.TimeColumn(TIMELINE, sequence=iterations)], columns)


def fixed(entity: str, *archetypes: rr.AsComponents) -> Chunk:
    """What does not change over time, as a chunk that can be sent to any number of recordings."""
    batches = [batch for archetype in archetypes for batch in archetype.as_component_batches()]
    return Chunk.from_columns(entity, [], [_single(b.component_descriptor(), b.as_arrow_array()) for b in batches])


def _single(descriptor: rr.ComponentDescriptor, row: pa.Array) -> Column:
    return Column(descriptor, pa.ListArray.from_arrays(pa.array([0, len(row)], pa.int32()), row))


def numbers(descriptor: rr.ComponentDescriptor, rows: Rows, dtype: Any = np.float64) -> Column:
    """Rows of numbers, each of any length."""
    flat = [np.asarray(row, dtype).ravel() for row in rows]
    return Column(descriptor, pa.ListArray.from_arrays(_offsets(flat), pa.array(_joined(flat, dtype))))


def vectors(descriptor: rr.ComponentDescriptor, rows: Rows, width: int) -> Column:
    """Rows of float32 vectors (n, width), each row of any n."""
    flat = [np.asarray(row, np.float32).reshape(-1, width) for row in rows]
    inner = pa.FixedSizeListArray.from_arrays(pa.array(_joined(flat, np.float32).ravel()), width)
    return Column(descriptor, pa.ListArray.from_arrays(_offsets(flat), _not_null(inner, width)))


def strips(descriptor: rr.ComponentDescriptor, rows: Rows) -> Column:
    """Rows of one line strip (n, 3) each; an empty strip is a row without one."""
    flat = [np.asarray(row, np.float32).reshape(-1, 3) for row in rows]
    points = _not_null(pa.FixedSizeListArray.from_arrays(pa.array(_joined(flat, np.float32).ravel()), 3), 3)
    kept = [f for f in flat if len(f)]
    field = pa.field("item", points.type, nullable=False)
    strip = pa.ListArray.from_arrays(_offsets(kept), points, type=pa.list_(field))
    outer = np.concatenate([[0], np.cumsum([min(len(f), 1) for f in flat])]).astype(np.int32)
    return Column(descriptor, pa.ListArray.from_arrays(pa.array(outer), strip))


def texts(descriptor: rr.ComponentDescriptor, rows: Sequence[Sequence[str]]) -> Column:
    """Rows of texts, each of any length."""
    return Column(descriptor, pa.array([list(row) for row in rows], pa.list_(pa.string())))


def bars(descriptor: rr.ComponentDescriptor, rows: Rows) -> Column:
    """Rows of one bar chart each: a tensor of one dimension."""
    example = rr.BarChart(np.zeros(1)).values
    assert example is not None
    layout = example.as_arrow_array().type
    flat = [np.asarray(row, np.float64).ravel() for row in rows]
    shape_type, buffer_type = layout.field("shape").type, layout.field("buffer").type
    shapes = pa.array([[len(f)] for f in flat], pa.list_(pa.uint64())).cast(shape_type)
    names = pa.nulls(len(flat), layout.field("names").type)
    codes = [buffer_type.field(i).name for i in range(buffer_type.num_fields)]
    children = [pa.array([], buffer_type.field(i).type) for i in range(len(codes))]
    at = codes.index("F64")
    item = buffer_type.field(at).type
    children[at] = pa.ListArray.from_arrays(_offsets(flat), pa.array(_joined(flat, np.float64)), type=item)
    kinds, places = np.full(len(flat), at, np.int8), np.arange(len(flat), dtype=np.int32)
    parts = [None, pa.py_buffer(kinds.tobytes()), pa.py_buffer(places.tobytes())]
    union = pa.Array.from_buffers(buffer_type, len(flat), parts, children=children)
    values = pa.StructArray.from_arrays([shapes, names, union], fields=list(layout))
    return Column(descriptor, pa.ListArray.from_arrays(pa.array(np.arange(len(flat) + 1, dtype=np.int32)), values))


def named(name: str) -> rr.ComponentDescriptor:
    """A component that no viewer draws, under its own name."""
    return rr.ComponentDescriptor(name)


def _offsets(rows: Sequence[NDArray[Any]]) -> pa.Array:
    return pa.array(np.concatenate([[0], np.cumsum([len(r) for r in rows])]).astype(np.int32))


def _joined(rows: Sequence[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    return np.concatenate(rows).astype(dtype, copy=False) if rows else np.zeros(0, dtype)


def _not_null(array: pa.FixedSizeListArray, width: int) -> pa.Array:
    # rerun's own schema says that neither vectors nor their elements can be missing.
    return array.cast(pa.list_(pa.field("item", pa.float32(), nullable=False), width))
