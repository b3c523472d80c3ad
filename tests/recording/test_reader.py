from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from tests.recording.runs import recorded_run, run_file, session
from verefine_viz.core.errors import InputError
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.rerun_viewer import open_viewer

pytestmark = pytest.mark.usefixtures("processes")


def error_of(path: Path) -> str:
    with pytest.raises(InputError, match=path.name) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_is_no_recording_or_holds_no_run_is_one_line(tmp_path: Path) -> None:
    error_of(tmp_path / "no.rrd")
    (tmp_path / "folder.rrd").mkdir()
    error_of(tmp_path / "folder.rrd")
    recorded_run(tmp_path / "run.rrd")
    content = (tmp_path / "run.rrd").read_bytes()
    cut = [content[:n] for n in (0, 2, 4, 1000, len(content) // 2, len(content) - 100)]
    for k, some in enumerate([*cut, b"RRF1 old", content[:16] + bytes(range(256)) * 40]):
        (tmp_path / f"{k}.rrd").write_bytes(some)
        error_of(tmp_path / f"{k}.rrd")
    with pytest.raises(InputError, match=r"1\.rrd"):
        open_viewer(tmp_path / "1.rrd")
    rec = rr.RecordingStream("another")
    rec.save(tmp_path / "other.rrd")
    rec.log("points", rr.Points3D([[0, 0, 0]]))
    rec.flush()
    rec.disconnect()
    assert "another program" in error_of(tmp_path / "other.rrd")


def test_flipped_bits_and_noise_anywhere_are_read_or_refused(tmp_path: Path) -> None:
    """Bytes that make no sense must not take the process with them."""
    path, rng = tmp_path / "run.rrd", np.random.default_rng(0)
    run = recorded_run(path, session(maps=False, iterations=2))
    whole = path.read_bytes()
    outcomes, messages = set[int](), list[str]()
    for k in range(40):
        content = bytearray(whole)
        at = int(rng.integers(4, len(content)))
        content[at : at + 40 * (k % 2) + 1] = rng.bytes(40 * (k % 2) + 1)
        path.write_bytes(content)
        try:
            outcomes.add(len(read_recording(path).iterations))
        except InputError as error:
            messages.append(str(error))
    assert all(n <= run.length for n in outcomes)
    assert messages
    assert not any("\n" in message for message in messages)


def test_the_run_file_beside_a_cut_recording_is_read(tmp_path: Path) -> None:
    s = session(maps=False, iterations=2)
    (tmp_path / "recordings").mkdir()
    recorded_run(tmp_path / "recordings" / "a.rrd", s)
    content = (tmp_path / "recordings" / "a.rrd").read_bytes()
    (tmp_path / "recordings" / "a.rrd").write_bytes(content[: len(content) // 2])
    for folder in (tmp_path / "runs", tmp_path / "recordings"):
        run = run_file(folder / "a.vfrun", s)
        record = read_recording(tmp_path / "recordings" / "a.rrd")
        assert (len(record.iterations), record.is_complete) == (run.length, True)
        (folder / "a.vfrun").unlink()
    error_of(tmp_path / "recordings" / "a.rrd")
