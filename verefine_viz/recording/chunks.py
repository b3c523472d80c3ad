"""Chunks of a recording, made from columns. What chunks of an entity look like is worked out once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from itertools import islice
from operator import gt
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from verefine_viz.recording.arrow_batch import Form
from verefine_viz.recording.columns import Column, Example, Kind, of_archetypes
from verefine_viz.recording.entities import TIMELINE
from verefine_viz.recording.piece import Piece, new_ids


def rows_of(entity: str, iterations: Sequence[int], columns: Sequence[Column], timeline: str = TIMELINE) -> Piece:
    """Rows of ``entity`` at ``iterations``, which must not fall, as one chunk."""
    if any(map(gt, iterations, islice(iterations, 1, None))):
        raise ValueError(f"iterations of {entity} are not in order")
    return _piece(entity, (timeline, np.array(iterations, np.int64)), columns)


def at(entity: str, iteration: int, *archetypes: rr.AsComponents) -> Piece:
    """Archetypes at one iteration, as a chunk."""
    return rows_of(entity, [iteration], of_archetypes(archetypes))


def fixed(entity: str, *archetypes: rr.AsComponents) -> Piece:
    """What does not change over time, as a chunk that can be sent to any number of recordings."""
    return fixed_row(entity, of_archetypes(archetypes))


def fixed_row(entity: str, columns: Sequence[Column]) -> Piece:
    """The same from columns of one row, for what every frame makes anew: archetypes take longer."""
    return _piece(entity, None, columns)


def _piece(entity: str, at: tuple[str, NDArray[np.int64]] | None, columns: Sequence[Column]) -> Piece:
    """Rows at the times of a timeline, or one of no time."""
    n_rows = columns[0].n_rows
    chunk_id, row_ids = new_ids(n_rows)
    nodes, buffers = [n_rows, 0], [b"", row_ids]
    timeline, times = at or (None, None)
    if times is not None:
        nodes += (len(times), 0)
        buffers += (b"", times.tobytes())
    for column in columns:
        nodes += column.nodes
        buffers += column.buffers
    form = _form(entity, timeline, tuple([c.kind for c in columns]))
    return Piece(chunk_id, at is None, form.stream(b"%016X%016x" % chunk_id, n_rows, nodes, buffers))


@lru_cache(maxsize=4096)
def _form(entity: str, timeline: str | None, kinds: tuple[Kind, ...]) -> Form:
    """What chunks of an entity look like."""
    before = _before(timeline)
    metadata = {**before.metadata, b"rerun:entity_path": entity.encode(), b"rerun:id": b"chunk_" + _NO_ID}
    return Form(pa.schema([*before, *(kind.field for kind in kinds)], metadata), _NO_ID)


_NO_ID = b"0" * 32


@cache
def _before(timeline: str | None) -> pa.Schema:
    """The columns before those of the components, and what rerun says about every chunk."""
    example: Any = Example(rr.Scalars.descriptor_scalars(), pa.array([[0.0], [0.0]]))
    times = [] if timeline is None else [rr.TimeColumn(timeline, sequence=[0, 0])]
    found: Any = Chunk.from_columns("/", times, [example]).to_record_batch().schema
    return pa.schema(list(found)[:-1], found.metadata)
