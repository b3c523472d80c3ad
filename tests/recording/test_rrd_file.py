"""Files of our own making, as rerun reads them."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from verefine_viz.core.errors import InputError
from verefine_viz.recording import chunks
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.reader import chunks_of
from verefine_viz.recording.rrd_file import RrdFile
from verefine_viz.recording.threaded_file import ThreadedFile


def values_in(path: Path) -> list[float]:
    found = [v for c in chunks_of(path) for v in c.to_record_batch().column("Scalars:scalars").to_pylist()]
    return np.ravel(found).tolist()


def test_chunks_are_in_the_file_when_they_were_sent(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    file = RrdFile(path)
    for k in range(3):
        file.send([chunks.at("/a", k, rr.Scalars([float(k)]))])
        assert values_in(path) == list(map(float, range(k + 1)))
    file.close(b"")
    assert values_in(path) == [0.0, 1.0, 2.0]


def test_one_chunk_in_two_files_belongs_to_both(tmp_path: Path) -> None:
    piece = chunks.fixed("/a", rr.Scalars([7.0]))
    for name in ("a", "b"):
        file = RrdFile(tmp_path / name)
        file.send([piece])
        file.close(b"")
    assert values_in(tmp_path / "a") == values_in(tmp_path / "b") == [7.0]
    assert (tmp_path / "a").read_bytes() != (tmp_path / "b").read_bytes()


def test_a_full_disk_is_one_line_however_often(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    said = r"^cannot write the recording /dev/full: No space left on device$"
    with pytest.raises(InputError, match=said):
        RrdFile(Path("/dev/full"))
    path = tmp_path / "a.rrd"
    file = RrdFile(path)
    os.dup2(os.open("/dev/full", os.O_WRONLY), file._file.fileno())
    for _ in range(2):
        with pytest.raises(InputError, match=r"a\.rrd: No space left on device$"):
            file.send([chunks.at("/a", 0, rr.Scalars([1.0]))])
    with pytest.raises(InputError, match="No space left"):
        file.close(b"")


def test_what_is_made_beside_the_run_is_in_the_file_after_a_flush(tmp_path: Path) -> None:
    path, makers = tmp_path / "a.rrd", set[int]()

    def made() -> Iterator[Piece]:
        makers.add(threading.get_ident())
        yield chunks.at("/a", 0, rr.Scalars([5.0]))

    file = ThreadedFile(RrdFile(path))
    file.send(made())
    file.flush()
    assert values_in(path) == [5.0]
    file.close(b"")
    assert threading.get_ident() not in makers


def test_what_goes_wrong_beside_the_run_is_told(tmp_path: Path) -> None:
    def wrong() -> Iterator[Piece]:
        yield chunks.at("/a", 0, rr.Scalars([5.0]))
        raise ValueError("a fault of the program")

    file = ThreadedFile(RrdFile(tmp_path / "a.rrd"))
    file.send(wrong())
    with pytest.raises(ValueError, match="a fault of the program"):
        file.flush()
    with pytest.raises(ValueError, match="a fault of the program"):
        file.close(b"")
    assert values_in(tmp_path / "a.rrd") == [5.0]
