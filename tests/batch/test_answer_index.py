"""The copy of a batch's answers counts only while it says what the run files say; the typed table says the same."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.batch.at_once import Loop
from verefine_viz.batch import index
from verefine_viz.batch.answer_index import INDEX, indexed_answers
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.runs import Runs
from verefine_viz.run.answers import COLUMNS


@pytest.fixture
def batch(loop: Loop) -> Path:
    loop.frames(12)
    loop.run()
    return loop.out


def test_a_batch_is_read_from_its_index_as_from_its_run_files(batch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    indexed = indexed_answers(batch)
    assert indexed is not None
    monkeypatch.setattr(index, "indexed_answers", lambda folder: None)
    read = read_batch(batch).rows
    assert len({row.frame for row in read}) == 12
    assert [row.frame for row in indexed] == [row.frame for row in read]
    for column in COLUMNS:
        assert [column.cell(row) for row in indexed] == [column.cell(row) for row in read], column.name


def newer(batch: Path) -> None:
    path = Runs(batch / "runs").path("0/3")
    os.utime(path, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns + 1))


def gone(batch: Path) -> None:
    Runs(batch / "runs").path("0/3").unlink()


def cut(batch: Path) -> None:
    (batch / INDEX).write_bytes((batch / INDEX).read_bytes()[:-7])


def changed(batch: Path) -> None:
    content = bytearray((batch / INDEX).read_bytes())
    content[len(content) // 2] ^= 1
    (batch / INDEX).write_bytes(content)


@pytest.mark.parametrize("spoil", [newer, gone, cut, changed])
def test_an_index_that_is_not_of_the_run_files_does_not_count(batch: Path, spoil: Callable[[Path], None]) -> None:
    spoil(batch)
    assert indexed_answers(batch) is None


def test_the_typed_table_has_the_columns_of_the_text_and_all_digits(batch: Path) -> None:
    table, rows = pq.read_table(batch / "frames.parquet"), read_batch(batch).rows
    with (batch / "frames.csv").open(newline="") as file:
        assert table.column_names == next(csv.reader(file))
    for name in table.column_names:
        assert table.column(name).to_pylist() == [getattr(row, name) for row in rows], name
