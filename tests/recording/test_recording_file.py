"""The file of a recording: what was sent is in it after a flush, and a disk that takes no more is one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr

from tests.full_disk import file_limit
from verefine_viz.core.errors import InputError
from verefine_viz.recording.recording_file import RecordingFile, chunks_of, read_bytes


def values_in(path: Path) -> list[float]:
    chunks: list[Any] = [c for c in chunks_of(path) if c.entity_path == "/a"]
    return [v for c in chunks for row in c.to_record_batch().column("Scalars:scalars").to_pylist() for v in row]


def numbers(*values: float) -> rr.ComponentColumnList:
    return rr.Scalars.columns(scalars=values)


def test_what_was_sent_is_in_the_file_after_a_flush(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    file = RecordingFile(path)
    for k in range(3):
        file.send("/a", [k], numbers(float(k)))
        file.flush()
        assert values_in(path) == list(map(float, range(k + 1)))
    file.close()
    assert values_in(path) == [0.0, 1.0, 2.0]


@pytest.mark.usefixtures("processes")
def test_bytes_come_back_from_a_whole_file_only(tmp_path: Path) -> None:
    path, content = tmp_path / "a.rrd", np.random.default_rng(0).bytes(100_000)
    file = RecordingFile(path)
    file.send("/a", [0], numbers(1.0))
    file.log_bytes("/b", content)
    file.close()
    assert read_bytes(path, "/b") == content
    assert read_bytes(path, "/c") is None
    path.write_bytes(path.read_bytes()[:-20])
    assert read_bytes(path, "/b") is None


def test_a_file_that_may_not_grow_is_one_line_however_often(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    file = RecordingFile(path)
    with file_limit(20_000):
        file.log("/a", rr.Points3D(np.random.default_rng(0).random((5000, 3))))
        for _ in range(2):
            with pytest.raises(InputError, match=r"a\.rrd: File too large$"):
                file.flush()
        with pytest.raises(InputError, match=r"File too large$"):
            file.close()
