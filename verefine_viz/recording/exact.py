"""What is not drawn: every iteration as it was, bit by bit, for reading back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr

from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.entry import Entry
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.row import Row


def exact(rows: Sequence[Row]) -> Piece:
    """Rows as one chunk of :data:`entities.EXACT`: the poses by their stages (float64, row by row) for whoever looks at
    recordings with other tools, and everything as :class:`Entry`.
    """
    sizes = [16 * len(row.stages) for row in rows]
    poses = columns.Ragged(sizes, np.concatenate([row.Ts_cam_obj for row in rows]))
    sent = [
        columns.texts(_named("stages"), [row.stages for row in rows]),
        columns.numbers(_named("Ts_cam_obj"), poses),
        columns.blobs(_named(ENTRY), [row.packed for row in rows]),
    ]
    return chunks.rows_of(entities.EXACT, [row.index for row in rows], sent)


def entry_from(values: Mapping[str, Any]) -> Entry:
    """The entry of one row of the chunk.

    Raises:
        KeyError, ValueError: it is missing or holds something else.
    """
    (packed,) = values[ENTRY]
    return Entry.read(bytes(packed))


ENTRY = "entry"


def _named(name: str) -> rr.ComponentDescriptor:
    return rr.ComponentDescriptor(f"{entities.PROPERTY}:{name}")
