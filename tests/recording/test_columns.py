"""Chunks made from arrays are what rerun makes of the same arrays."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st
from rerun.chunk import Chunk

from verefine_viz.recording import chunks, columns
from verefine_viz.recording.columns import Column
from verefine_viz.recording.entities import TIMELINE
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.reader import chunks_of
from verefine_viz.recording.rrd_file import RrdFile

numbers = st.floats(-1e3, 1e3, width=32)
lengths = st.lists(st.integers(0, 4), min_size=1, max_size=5)


def both(kind: str, rows: list[list[float]]) -> tuple[Column, Any]:
    """Ours, and rerun's own."""
    flat = [x for row in rows for x in row]
    points = [np.array(row).reshape(-1, 1).repeat(3, axis=1) for row in rows]
    labels = [[f"{x:g} µ" for x in row] for row in rows]
    lengths = [len(row) for row in rows]
    match kind:
        case "numbers":
            ours = columns.numbers(rr.Scalars.descriptor_scalars(), rows)
            return ours, rr.Scalars.columns(scalars=flat).partition(lengths)
        case "colors":
            colors = [[int(abs(x)) for x in row] for row in rows]
            ours = columns.numbers(rr.Points3D.descriptor_colors(), colors, np.uint32)
            return ours, rr.Points3D.columns(colors=np.array([c for row in colors for c in row], np.uint32)).partition(
                lengths
            )
        case "vectors":
            ours = columns.vectors(rr.Points3D.descriptor_positions(), points, 3)
            return ours, rr.Points3D.columns(positions=np.concatenate(points)).partition(lengths)
        case "strips":
            ours = columns.strips(rr.LineStrips3D.descriptor_strips(), points)
            drawn = [p.astype(np.float32) for p in points if len(p)]
            return ours, rr.LineStrips3D.columns(strips=drawn).partition([min(n, 1) for n in lengths])
        case "blobs":
            content = [np.array(row, np.float32).tobytes() for row in rows]
            ours = columns.blobs(rr.EncodedImage.descriptor_blob(), content)
            return ours, rr.EncodedImage.columns(blob=content)
        case "bars":
            ours = columns.bars(rr.BarChart.descriptor_values(), rows)
            tensors = [rr.BarChart(np.array(row, np.float64)).values.as_arrow_array() for row in rows]  # type: ignore[union-attr]
            batch = rr.components.TensorDataBatch(pa.concat_arrays(tensors)).described(rr.BarChart.descriptor_values())
            return ours, rr.ComponentColumnList([rr.ComponentColumn(batch.component_descriptor(), batch)])
    return columns.texts(rr.TextLog.descriptor_text(), labels), rr.TextLog.columns(
        text=[text for row in labels for text in row]
    ).partition(lengths)


def content(chunk: Chunk) -> tuple[Any, ...]:
    """All but its ids, which are never the same."""
    batch: Any = chunk.to_record_batch()
    fields = [(f.name, f.type, f.nullable, f.metadata) for f in batch.schema]
    return chunk.entity_path, chunk.is_static, fields, repr([c.to_pylist() for c in batch.columns[1:]])


def through_a_file(piece: Piece) -> Chunk:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.rrd"
        file = RrdFile(path)
        file.send([piece])
        file.close(b"")
        (chunk,) = chunks_of(path)
    return chunk


@pytest.mark.parametrize("kind", ["numbers", "colors", "vectors", "strips", "blobs", "bars", "texts"])
@given(data=st.data())
def test_columns_through_a_file_are_what_rerun_makes_of_them(kind: str, data: st.DataObject) -> None:
    rows = [data.draw(st.lists(numbers, min_size=n, max_size=n)) for n in data.draw(lengths)]
    iterations = sorted(data.draw(st.lists(st.integers(0, 99), min_size=len(rows), max_size=len(rows))))
    ours, theirs = both(kind, rows)
    expected = Chunk.from_columns("/a/b", [rr.TimeColumn(TIMELINE, sequence=iterations)], theirs)
    assert content(through_a_file(chunks.rows_of("/a/b", iterations, [ours]))) == content(expected)


@given(st.lists(st.tuples(numbers, numbers, numbers), max_size=5), st.text(max_size=20))
def test_static_archetypes_through_a_file_are_what_rerun_makes_of_them(
    points: list[tuple[float, float, float]], label: str
) -> None:
    cloud = rr.Points3D(np.array(points).reshape(-1, 3), colors=[(1, 2, 3)], labels=[label])
    batches = cloud.as_component_batches()
    parts: Any = [rr.ComponentColumn(b.component_descriptor(), b, lengths=[len(b.as_arrow_array())]) for b in batches]
    expected = Chunk.from_columns("/a", [], parts)
    assert content(through_a_file(chunks.fixed("/a", cloud))) == content(expected)


def test_rows_have_ids_of_their_own_that_rise() -> None:
    batches = [
        chunks.rows_of("/a", [1, 1, 2], [columns.numbers(rr.Scalars.descriptor_scalars(), [[1.0]] * 3)]).batch
        for _ in range(3)
    ]
    ids = [i.hex() for batch in batches for i in batch.column(0).to_pylist()]
    assert ids == sorted(ids)
    assert len(set(ids)) == 9
    assert len({batch.schema.metadata[b"rerun:id"] for batch in batches}) == 3


def test_iterations_that_fall_are_refused() -> None:
    with pytest.raises(ValueError, match="iterations of /a are not in order"):
        chunks.rows_of("/a", [2, 1], [columns.numbers(rr.Scalars.descriptor_scalars(), [[1.0]] * 2)])
