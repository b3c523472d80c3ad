from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from verefine_viz.core.errors import InputError
from verefine_viz.recording import columns
from verefine_viz.recording.direct_file import DirectFile
from verefine_viz.recording.reader import chunks_of


def test_chunks_are_in_the_file_when_they_were_sent(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    file = DirectFile(path)
    for k in range(3):
        file.send([columns.at("/a", k, rr.Scalars([float(k)]))])
        assert sum(c.num_rows for c in chunks_of(path)) == k + 1
    file.close(b"")
    values = [v for c in chunks_of(path) for v in c.to_record_batch().column("Scalars:scalars").to_pylist()]
    assert np.ravel(values).tolist() == [0.0, 1.0, 2.0]


def test_a_full_disk_is_one_line_however_often(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    file = DirectFile(Path("/dev/full"))
    for _ in range(2):
        with pytest.raises(InputError, match=r"^cannot write the recording /dev/full: No space left on device$"):
            file.send([columns.at("/a", 0, rr.Scalars([1.0]))])
    with pytest.raises(InputError, match="No space left"):
        file.close(b"")
