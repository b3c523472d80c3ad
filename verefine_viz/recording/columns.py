"""Arrow columns and chunks for rerun, made from plain arrays in one go.

Building the lists here, instead of through one archetype per row, is what keeps a recording cheap. How a column is
called and described in a chunk is learnt from rerun, once for each kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import accumulate, chain, islice
from operator import gt
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
    if any(map(gt, iterations, islice(iterations, 1, None))):
        raise ValueError(f"iterations of {entity} are not in order")
    return _piece(entity, [pa.array(np.array(iterations, np.int64))], columns)


def at(entity: str, iteration: int, *archetypes: rr.AsComponents) -> Piece:
    """Archetypes at one iteration, as a chunk."""
    return rows_of(entity, [iteration], _parts(archetypes))


def fixed(entity: str, *archetypes: rr.AsComponents) -> Piece:
    """What does not change over time, as a chunk that can be sent to any number of recordings."""
    return fixed_row(entity, _parts(archetypes))


def fixed_row(entity: str, columns: Sequence[Column]) -> Piece:
    """The same from columns of one row, for what every frame makes anew: archetypes take longer."""
    return _piece(entity, [], columns)


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


def _piece(entity: str, times: list[pa.Array], columns: Sequence[Column]) -> Piece:
    n_rows = len(columns[0].rows)
    chunk_id, row_ids = new_ids(n_rows)
    before = _before(bool(times))
    fields = [_field(c.descriptor, c.rows.type) for c in columns]
    metadata = {**before.metadata, b"rerun:entity_path": entity.encode(), b"rerun:id": chunk_id}
    schema = pa.schema([*before, *fields], metadata)
    return Piece(pa.RecordBatch.from_arrays([row_ids, *times, *(c.rows for c in columns)], schema=schema))


@lru_cache(maxsize=256)
def _field(descriptor: rr.ComponentDescriptor, layout: pa.DataType) -> pa.Field:
    """How rerun calls and describes a column."""
    example: Any = Column(descriptor, pa.nulls(1, layout))
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
    return Column(descriptor, pa.ListArray.from_arrays(_offsets([len(row)]), row))


def numbers(descriptor: rr.ComponentDescriptor, rows: Rows, dtype: Any = np.float64) -> Column:
    """Rows of numbers, each of any length."""
    lengths, values = _flat(rows, dtype, 1)
    return Column(descriptor, pa.ListArray.from_arrays(_offsets(lengths), pa.array(values)))


def vectors(descriptor: rr.ComponentDescriptor, rows: Rows, width: int, dtype: Any = np.float32) -> Column:
    """Rows of vectors (n, width), each row of any n."""
    lengths, values = _flat(rows, dtype, width)
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
    flat = pa.array(list(chain.from_iterable(rows)), pa.string())
    return Column(descriptor, pa.ListArray.from_arrays(_offsets([len(row) for row in rows]), flat))


def one_value(descriptor: rr.ComponentDescriptor, value: int | str) -> Column:
    """One row with one number or text."""
    return _single(descriptor, pa.array([value]))


def bars(descriptor: rr.ComponentDescriptor, rows: Rows) -> Column:
    """Rows of one bar chart each: a tensor of one dimension."""
    layout = _tensor_type()
    lengths, numbers_ = _flat(rows, np.float64, 1)
    shape_type, buffer_type = layout.field("shape").type, layout.field("buffer").type
    each = pa.array(np.arange(len(lengths) + 1, dtype=np.int32))
    shapes = pa.ListArray.from_arrays(each, pa.array(np.array(lengths, np.uint64)), type=shape_type)
    names = pa.nulls(len(lengths), layout.field("names").type)
    codes = [buffer_type.field(i).name for i in range(buffer_type.num_fields)]
    children = list(_no_numbers())
    at = codes.index("F64")
    item = buffer_type.field(at).type
    children[at] = pa.ListArray.from_arrays(_offsets(lengths), pa.array(numbers_), type=item)
    kinds, places = np.full(len(lengths), at, np.int8), np.arange(len(lengths), dtype=np.int32)
    parts = [None, pa.py_buffer(kinds.tobytes()), pa.py_buffer(places.tobytes())]
    union = pa.Array.from_buffers(buffer_type, len(lengths), parts, children=children)
    values = pa.StructArray.from_arrays([shapes, names, union], fields=list(layout))
    return Column(descriptor, pa.ListArray.from_arrays(each, values))


@cache
def _no_numbers() -> tuple[pa.Array, ...]:
    """The branches of a tensor's numbers, all empty."""
    kinds = _tensor_type().field("buffer").type
    return tuple(pa.array([], kinds.field(i).type) for i in range(kinds.num_fields))


@cache
def _tensor_type() -> pa.StructType:
    example = rr.BarChart(np.zeros(1)).values
    assert example is not None
    return example.as_arrow_array().type


def _flat(rows: Rows, dtype: Any, width: int) -> tuple[Sequence[int], NDArray[Any]]:
    """How many elements of ``width`` numbers each row has, and all numbers one after another."""
    if isinstance(rows, np.ndarray):
        n = rows[0].size // width if len(rows) else 0
        return (n,) * len(rows), np.ascontiguousarray(rows, dtype).ravel()
    arrays = [np.asarray(row) for row in rows]
    flat = np.concatenate(arrays, axis=None, dtype=dtype, casting="unsafe") if arrays else np.zeros(0, dtype)
    return [array.size // width for array in arrays], flat


def _offsets(lengths: Sequence[int]) -> pa.Array:
    first = lengths[0] if lengths else 0
    return _even_offsets(len(lengths), first) if lengths.count(first) == len(lengths) else _uneven_offsets(lengths)


@lru_cache(maxsize=1024)
def _even_offsets(n_rows: int, length: int) -> pa.Array:
    return _uneven_offsets([length] * n_rows)


def _uneven_offsets(lengths: Sequence[int]) -> pa.Array:
    # Arrow reads a numpy array as it is, a list item by item.
    return pa.array(np.fromiter(accumulate(lengths, initial=0), np.int32, len(lengths) + 1))


def _fixed_width(values: NDArray[Any], width: int) -> pa.FixedSizeListArray:
    # rerun's own schema says that neither vectors nor their elements can be missing.
    numbers_ = pa.array(values)
    return pa.FixedSizeListArray.from_arrays(numbers_, type=_fixed_width_type(numbers_.type, width))


@cache
def _fixed_width_type(item: pa.DataType, width: int) -> pa.DataType:
    return pa.list_(pa.field("item", item, nullable=False), width)
