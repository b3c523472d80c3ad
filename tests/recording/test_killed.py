"""A writer that is killed leaves all its iterations in the run file, and a recording that can be opened."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.fakes import FakeVerifier, box_problem
from tests.recording.runs import n_drawn, new_run, recorded_run, run_file, session
from verefine_viz.batch.draw_run_file import RunDrawer
from verefine_viz.recording.entities import CURVES
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import BLOCK_WITH_MAPS, Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run
from verefine_viz.run.run_file import as_read, read_run_file
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("processes")

ROOT = Path(__file__).resolve().parents[2]


def drawn(run: Path, folder: Path) -> Path:
    """The recording of a run file, drawn afterwards."""
    recording = folder / "run.rrd"
    RunDrawer().draw(run, recording)
    return recording


def killed_run(path: Path, n_iterations: int, maps: bool) -> int:
    """Kills a recorded run with SIGKILL after it said that iteration ``n_iterations`` is done; the last one it said."""
    command = [sys.executable, "-m", "tests.recording.endless", str(path), "maps" if maps else "bare"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) >= n_iterations:
                process.kill()
                break
        rest = process.stdout.read().split()
    return int(rest[-1]) if rest else n_iterations


@pytest.mark.parametrize("maps", [True, False])
def test_a_killed_run_keeps_all_its_iterations_and_what_is_not_drawn_can_be(
    tmp_path: Path, maps: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.rrd"
    last = killed_run(path, 33, maps)
    record = read_recording(path)
    assert not record.is_complete
    assert len(record.iterations) >= last
    run = new_run(session(iterations=1000, maps=maps), box_problem(3))
    for iteration in record.iterations:
        assert first_difference(iteration, as_read(run.step())) is None
    # The recording itself is there up to its last block.
    assert len(chunks_of(path)) > 5
    assert n_drawn(path) == (len(record.iterations) // BLOCK_WITH_MAPS * BLOCK_WITH_MAPS if maps else 0)
    if not maps:
        monkeypatch.setattr(Toolbox, "problem", lambda self, frame: box_problem(3))
        (tmp_path / "out").mkdir()
        assert n_drawn(drawn(tmp_path / "run.vfrun", tmp_path / "out")) == len(record.iterations)


def test_a_run_file_is_drawn_as_it_would_have_been_while_it_ran(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    s, problem = session(maps=False), box_problem(3, 2)
    monkeypatch.setattr(Toolbox, "problem", lambda self, frame: problem)
    recorded_run(tmp_path / "live.rrd", s, problem)
    run_file(tmp_path / "run.vfrun", s, problem)
    path = drawn(tmp_path / "run.vfrun", tmp_path)
    assert curves(path) == curves(tmp_path / "live.rrd")
    assert rows(path) == rows(tmp_path / "live.rrd")
    whole = read_run_file(tmp_path / "run.vfrun")
    assert first_difference(read_recording(path).iterations, whole.iterations) is None


def test_maps_are_drawn_from_a_record_too(tmp_path: Path) -> None:
    s, problem = session(iterations=2), box_problem(3, 2)
    run_file(tmp_path / "run.vfrun", s, problem)
    recorded_run(tmp_path / "live.rrd", s, problem)
    recorder = Recorder(tmp_path / "drawn.rrd", s, problem, lambda _: FakeVerifier())
    Run.from_record(read_run_file(tmp_path / "run.vfrun"), problem, [recorder])
    recorder.close((tmp_path / "run.vfrun").read_bytes())
    assert rows(tmp_path / "drawn.rrd") == rows(tmp_path / "live.rrd")


def rows(path: Path) -> dict[str, int]:
    """How much there is of everything that changes over the iterations."""
    found: dict[str, int] = {}
    for chunk in chunks_of(path):
        if not chunk.is_static:
            found[chunk.entity_path] = found.get(chunk.entity_path, 0) + chunk.num_rows
    return found


def curves(path: Path) -> dict[tuple[str, int], list[str]]:
    """All points of all curves."""
    found: dict[tuple[str, int], list[str]] = {}
    for chunk in chunks_of(path):
        if chunk.entity_path.startswith(CURVES) and not chunk.is_static:
            batch = chunk.to_record_batch()
            values = batch.column(batch.schema.get_field_index("Scalars:scalars")).to_pylist()
            times = batch.column(batch.schema.get_field_index("iteration")).to_pylist()
            found |= {(chunk.entity_path, t): [repr(x) for x in v] for t, v in zip(times, values, strict=True)}
    return found
