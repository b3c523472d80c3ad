"""What is not drawn: every iteration as it was, bit by bit, for reading back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import rerun as rr

from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.block import Block
from verefine_viz.recording.entry import Entry
from verefine_viz.recording.piece import Piece


def exact(block: Block) -> Piece:
    """Iterations as one chunk of :data:`entities.EXACT`: the poses by their stages (float64, row by row) for whoever
    looks at recordings with other tools, and everything as :class:`Entry`.
    """
    sent = [
        columns.texts(_named("stages"), block.names),
        columns.numbers(_named("Ts_cam_obj"), columns.Ragged([16 * n for n in block.n_stages], block.Ts_cam_obj)),
        columns.blobs(_named(ENTRY), [entry.packed for entry in block.entries]),
    ]
    return chunks.rows_of(entities.EXACT, block.indices, sent)


def entry_from(values: Mapping[str, Any]) -> Entry:
    """The entry of one row of the chunk.

    Raises:
        ValueError: it is missing or holds something else.
    """
    rows = values.get(ENTRY)
    if rows is None or len(rows) != 1:
        raise ValueError("it is missing")
    return Entry.read(bytes(rows[0]))


ENTRY = "entry"


def _named(name: str) -> rr.ComponentDescriptor:
    return rr.ComponentDescriptor(f"{entities.PROPERTY}:{name}")
