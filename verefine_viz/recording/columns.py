"""Arrow columns for rerun, made from plain arrays in one go.

Building the lists here, instead of through one archetype per row, is what keeps a recording cheap. How a column is
described is learnt from rerun, once for each kind.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from itertools import accumulate, chain
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import ArrayLike, NDArray
from rerun.chunk import Chunk

from verefine_viz.recording.arrow_batch import parts


@dataclass(frozen=True, eq=False)
class Ragged:
    """Rows of different lengths, one after another."""

    lengths: Sequence[int]
    values: NDArray[Any]
    """(sum of lengths, …)."""


Rows: TypeAlias = Sequence[ArrayLike] | NDArray[Any] | Ragged


@dataclass(frozen=True, eq=False)
class Kind:
    """What a column is called, and how its rows lie in memory."""

    descriptor: rr.ComponentDescriptor
    layout: pa.DataType

    @cached_property
    def field(self) -> pa.Field:
        """How rerun describes such a column."""
        example: Any = Example(self.descriptor, pa.nulls(1, self.layout))
        found: Any = Chunk.from_columns("/", [], [example]).to_record_batch().schema
        return found.field(1)


@dataclass(frozen=True, eq=False)
class Column:
    """One component over many rows, each of which holds a list."""

    kind: Kind
    n_rows: int
    nodes: Sequence[int]
    """As :meth:`Form.stream` takes them, like the buffers."""
    buffers: Sequence[bytes]


def transforms(Ts: ArrayLike) -> list[Column]:
    """Rows of one transform each, from poses (n, 4, 4)."""
    poses = np.asarray(Ts, np.float32)
    # rerun keeps matrices column by column.
    matrices = poses[:, :3, :3].transpose(0, 2, 1).reshape(-1, 1, 9)
    return [
        vectors(rr.Transform3D.descriptor_translation(), poses[:, None, :3, 3], 3),
        vectors(rr.Transform3D.descriptor_mat3x3(), matrices, 9),
    ]


def packed(colors: NDArray[np.uint8], alpha: int = 255) -> NDArray[np.uint32]:
    """Colours (n, 3) as rerun keeps them: red in the highest byte."""
    r, g, b = colors.astype(np.uint32).T
    return r << 24 | g << 16 | b << 8 | np.uint32(alpha)


@dataclass(frozen=True)
class Example:
    """A column as rerun takes it, to ask what it makes of one."""

    descriptor: rr.ComponentDescriptor
    rows: pa.Array

    def component_descriptor(self) -> rr.ComponentDescriptor:
        return self.descriptor

    def as_arrow_array(self) -> pa.Array:
        return self.rows


def of_archetypes(archetypes: Sequence[rr.AsComponents]) -> list[Column]:
    """One row of each component."""
    batches = [batch for archetype in archetypes for batch in archetype.as_component_batches()]
    return [_single(b.component_descriptor(), b.as_arrow_array()) for b in batches]


def _single(descriptor: rr.ComponentDescriptor, row: pa.Array) -> Column:
    return of_arrow(descriptor, pa.ListArray.from_arrays(pa.array([0, len(row)], pa.int32()), row))


def of_arrow(descriptor: rr.ComponentDescriptor, rows: pa.ListArray) -> Column:
    """Rows of anything."""
    return Column(_kind(descriptor, rows.type), len(rows), *parts(rows))


_kind = lru_cache(maxsize=1024)(Kind)


def numbers(descriptor: rr.ComponentDescriptor, rows: Rows, dtype: Any = np.float64) -> Column:
    """Rows of numbers, each of any length."""
    lengths, values = _flat(rows, dtype, 1)
    n_rows, nodes, buffers = _listed(lengths)
    return Column(_numbers(descriptor, dtype), n_rows, (*nodes, len(values), 0), (*buffers, b"", values.tobytes()))


def vectors(descriptor: rr.ComponentDescriptor, rows: Rows, width: int, dtype: Any = np.float32) -> Column:
    """Rows of vectors (n, width), each row of any n."""
    lengths, values = _flat(rows, dtype, width)
    n_rows, nodes, buffers = _listed(lengths)
    n = len(values)
    return Column(
        _vectors(descriptor, dtype, width),
        n_rows,
        (*nodes, n // width, 0, n, 0),
        (*buffers, b"", b"", values.tobytes()),
    )


def strips(descriptor: rr.ComponentDescriptor, rows: Rows) -> Column:
    """Rows of one line strip (n, 3) each; an empty strip is a row without one."""
    lengths, values = _flat(rows, np.float32, 3)
    n_rows, nodes, buffers = _listed([min(n, 1) for n in lengths])
    _, inner_nodes, inner_buffers = _listed([n for n in lengths if n])
    n = len(values)
    return Column(
        _strips(descriptor),
        n_rows,
        (*nodes, *inner_nodes, n // 3, 0, n, 0),
        (*buffers, *inner_buffers, b"", b"", values.tobytes()),
    )


def texts(descriptor: rr.ComponentDescriptor, rows: Sequence[Sequence[str]]) -> Column:
    """Rows of texts, each of any length."""
    return _encoded(descriptor, list(map(len, rows)), chain.from_iterable(rows))


def text(descriptor: rr.ComponentDescriptor, rows: Sequence[str]) -> Column:
    """Rows of one text each."""
    return _encoded(descriptor, (1,) * len(rows), rows)


def _encoded(descriptor: rr.ComponentDescriptor, lengths: Sequence[int], texts: Iterable[str]) -> Column:
    flat = list(map(str.encode, texts))
    n_rows, nodes, buffers = _listed(lengths)
    ends = _offsets(list(map(len, flat)))
    return Column(_texts(descriptor), n_rows, (*nodes, len(flat), 0), (*buffers, b"", ends, b"".join(flat)))


def blobs(descriptor: rr.ComponentDescriptor, rows: Sequence[bytes]) -> Column:
    """Rows of one run of bytes each."""
    n_rows, nodes, buffers = _listed([1] * len(rows))
    _, inner_nodes, inner_buffers = _listed([len(row) for row in rows])
    content = b"".join(rows)
    return Column(
        _blobs(descriptor), n_rows, (*nodes, *inner_nodes, len(content), 0), (*buffers, *inner_buffers, b"", content)
    )


def one_value(descriptor: rr.ComponentDescriptor, value: int | str) -> Column:
    """One row with one number or text."""
    return text(descriptor, [value]) if isinstance(value, str) else numbers(descriptor, [[value]], np.int64)


def bars(descriptor: rr.ComponentDescriptor, rows: Rows) -> Column:
    """Rows of one bar chart each: a tensor of one dimension."""
    lengths, values = _flat(rows, np.float64, 1)
    like = _bars_of_zeros(descriptor, tuple(lengths))
    buffers = list(like.buffers)
    buffers[_place_of_bars()] = values.tobytes()
    return Column(like.kind, like.n_rows, like.nodes, buffers)


@lru_cache(maxsize=256)
def _bars_of_zeros(descriptor: rr.ComponentDescriptor, lengths: tuple[int, ...], value: float = 0.0) -> Column:
    """All that does not depend on how high the bars are."""
    layout = _tensor_type()
    shape_type, buffer_type = layout.field("shape").type, layout.field("buffer").type
    n = len(lengths)
    each = pa.array(np.arange(n + 1, dtype=np.int32))
    shapes = pa.ListArray.from_arrays(each, pa.array(np.array(lengths, np.uint64)), type=shape_type)
    names = pa.nulls(n, layout.field("names").type)
    codes = [buffer_type.field(i).name for i in range(buffer_type.num_fields)]
    children = [pa.array([], buffer_type.field(i).type) for i in range(buffer_type.num_fields)]
    at = codes.index("F64")
    ends = pa.array(np.cumsum([0, *lengths]).astype(np.int32))
    children[at] = pa.ListArray.from_arrays(
        ends, pa.array(np.full(sum(lengths), value)), type=buffer_type.field(at).type
    )
    kinds, places = np.full(n, at, np.int8), np.arange(n, dtype=np.int32)
    buffers = [None, pa.py_buffer(kinds.tobytes()), pa.py_buffer(places.tobytes())]
    union = pa.Array.from_buffers(buffer_type, n, buffers, children=children)
    tensors = pa.StructArray.from_arrays([shapes, names, union], fields=list(layout))
    return of_arrow(descriptor, pa.ListArray.from_arrays(each, tensors))


@cache
def _place_of_bars() -> int:
    """Which of the buffers holds the heights of the bars."""
    zero, one = (_bars_of_zeros(rr.BarChart.descriptor_values(), (1,), value).buffers for value in (0.0, 1.0))
    (place,) = (k for k, (a, b) in enumerate(zip(zero, one, strict=True)) if a != b)
    return place


@cache
def _tensor_type() -> pa.StructType:
    example = rr.BarChart(np.zeros(1)).values
    assert example is not None
    return example.as_arrow_array().type


@lru_cache(maxsize=256)
def _numbers(descriptor: rr.ComponentDescriptor, dtype: Any) -> Kind:
    return Kind(descriptor, pa.list_(pa.from_numpy_dtype(dtype)))


@lru_cache(maxsize=256)
def _vectors(descriptor: rr.ComponentDescriptor, dtype: Any, width: int) -> Kind:
    return Kind(descriptor, pa.list_(_vector_type(pa.from_numpy_dtype(dtype), width)))


@lru_cache(maxsize=256)
def _strips(descriptor: rr.ComponentDescriptor) -> Kind:
    strip = pa.list_(pa.field("item", _vector_type(pa.float32(), 3), nullable=False))
    return Kind(descriptor, pa.list_(strip))


@lru_cache(maxsize=256)
def _texts(descriptor: rr.ComponentDescriptor) -> Kind:
    return Kind(descriptor, pa.list_(pa.string()))


@lru_cache(maxsize=256)
def _blobs(descriptor: rr.ComponentDescriptor) -> Kind:
    blob = pa.list_(pa.field("item", pa.uint8(), nullable=False))
    return Kind(descriptor, pa.list_(blob))


def _vector_type(item: pa.DataType, width: int) -> pa.DataType:
    # rerun's own schema says that neither vectors nor their elements can be missing.
    return pa.list_(pa.field("item", item, nullable=False), width)


def _flat(rows: Rows, dtype: Any, width: int) -> tuple[Sequence[int], NDArray[Any]]:
    """How many elements of ``width`` numbers each row has, and all numbers one after another."""
    if isinstance(rows, Ragged):
        return rows.lengths, np.ascontiguousarray(rows.values, dtype).ravel()
    if isinstance(rows, np.ndarray):
        n = rows[0].size // width if len(rows) else 0
        return (n,) * len(rows), np.ascontiguousarray(rows, dtype).ravel()
    arrays = [np.asarray(row) for row in rows]
    flat = np.concatenate(arrays, axis=None, dtype=dtype, casting="unsafe") if arrays else np.zeros(0, dtype)
    return [array.size // width for array in arrays], flat


def _listed(lengths: Sequence[int]) -> tuple[int, tuple[int, int], tuple[bytes, bytes]]:
    """How many lists of these lengths there are; their nodes and buffers."""
    n = len(lengths)
    return n, (n, 0), (b"", _offsets(lengths))


def _offsets(lengths: Sequence[int]) -> bytes:
    return np.fromiter(accumulate(lengths, initial=0), np.int32, len(lengths) + 1).tobytes()
