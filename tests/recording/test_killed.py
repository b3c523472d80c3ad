from __future__ import annotations

import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.fakes import box_problem
from tests.recording.runs import ends_of_messages, n_drawn, new_run, recorded_run, session
from verefine_viz.recording.entities import CURVES, LOSSLESS
from verefine_viz.recording.lossless_log import as_recorded, read_journal
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recording_file import chunks_of, journal_path, part_path
from verefine_viz.recording.rerun_viewer import completed
from verefine_viz.recording.verify import first_difference

pytestmark = pytest.mark.usefixtures("processes")

ROOT = Path(__file__).resolve().parents[2]


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
def test_a_killed_run_keeps_all_its_iterations(tmp_path: Path, maps: bool) -> None:
    path = tmp_path / "run.rrd"
    last = killed_run(path, 33, maps)
    assert not path.exists()
    recorded = read_recording(path)
    assert not recorded.is_complete
    assert len(recorded.entries) >= last
    run = new_run(session(iterations=1000, maps=maps), box_problem(3))
    for iteration in recorded.iterations:
        assert first_difference(iteration, as_recorded(run.step())) is None


def test_a_killed_recording_is_completed_for_the_viewer(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    killed_run(path, 33, maps=False)
    before = read_recording(path)
    assert n_drawn(part_path(path)) < len(before.entries)
    out = tmp_path / "out"
    out.mkdir()
    after = read_recording(completed(before, out))
    assert after.is_complete
    assert n_drawn(after.path) == len(before.entries)
    assert first_difference(after.iterations, before.iterations) is None


def test_completing_draws_what_the_killed_run_would_have_drawn(tmp_path: Path) -> None:
    """The curves of a completed recording are those of one that was never cut."""
    recorded_run(tmp_path / "whole.rrd", session(maps=False), block=4)
    stopped = new_run_with_journal(tmp_path / "cut.rrd")
    assert 0 < n_drawn(stopped.path) < len(stopped.entries)
    (tmp_path / "out").mkdir()
    fixed = completed(stopped, tmp_path / "out")
    assert curves(fixed) == curves(tmp_path / "whole.rrd")


@pytest.mark.parametrize("maps", [True, False])
def test_completing_draws_all_that_a_cut_file_still_holds(tmp_path: Path, maps: bool) -> None:
    """Wherever it was cut: in the middle of a block there are iterations without curves."""
    recorded_run(tmp_path / "whole.rrd", session(maps=maps), block=10)
    content, whole = (tmp_path / "whole.rrd").read_bytes(), read_recording(tmp_path / "whole.rrd")
    ends = list(ends_of_messages(content))
    lengths = set()
    for k, end in enumerate(ends[len(ends) // 6 :: 7]):
        cut = tmp_path / f"{k}.rrd"
        cut.write_bytes(content[:end])
        recorded = read_recording(cut)
        (tmp_path / f"{k}").mkdir()
        fixed = completed(recorded, tmp_path / f"{k}")
        n = len(recorded.entries)
        lengths.add(n)
        assert first_difference(read_recording(fixed).iterations, whole.iterations[:n]) is None
        if n:
            assert curves(fixed) == {at: v for at, v in curves(whole.path).items() if at[1] <= n}
        if n == len(whole.entries):
            assert numbers_of_rows(fixed) == numbers_of_rows(whole.path)
    assert {10, 20, 30} <= lengths


def numbers_of_rows(path: Path) -> Counter[str]:
    """How much there is of everything that changes over the iterations, score maps aside."""
    found: Counter[str] = Counter()
    for chunk in chunks_of(path):
        if not chunk.is_static and "maps/" not in chunk.entity_path:
            found[chunk.entity_path] += chunk.num_rows
    return found


def new_run_with_journal(path: Path):
    """The files of a run that stopped at its last iteration, before its recorder closed."""
    from tests.fakes import FakeVerifier
    from verefine_viz.recording.recorder import Recorder

    s, problem = session(maps=False), box_problem(3, 2)
    recorder = Recorder(path, s, problem, lambda _: FakeVerifier(), block=4)
    run = new_run(s, problem)
    recorder.on_start(run.state)
    while not run.is_done:
        iteration = run.step()
        recorder.on_iteration(run.state, iteration)
    copy = path.with_name("killed.rrd")
    shutil.copy(part_path(path), part_path(copy))
    shutil.copy(journal_path(path), journal_path(copy))
    recorder.close()
    return read_recording(copy)


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


def test_a_file_cut_in_a_message_gives_what_is_whole(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session(maps=False), block=3)
    whole = read_recording(tmp_path / "run.rrd")
    content = (tmp_path / "run.rrd").read_bytes()
    n_read = []
    for share in (0.6, 0.75, 0.9, 0.99):
        cut = tmp_path / "cut.rrd"
        cut.write_bytes(content[: int(len(content) * share)])
        found = read_recording(cut).iterations
        assert first_difference(found, whole.iterations[: len(found)]) is None
        n_read.append(len(found))
    assert n_read == sorted(n_read)
    assert n_read[-1] > 0


def test_a_short_recording_with_maps_keeps_what_lies_before_a_cut(tmp_path: Path) -> None:
    run = recorded_run(tmp_path / "run.rrd", block=200)
    content = (tmp_path / "run.rrd").read_bytes()
    (tmp_path / "cut.rrd").write_bytes(content[: len(content) // 3])
    assert 10 <= len(read_recording(tmp_path / "cut.rrd").entries) < run.length


def n_entries(journal: Path, content: bytes) -> int:
    """How many whole ones a journal with that content has."""
    journal.write_bytes(content)
    return len(read_journal(journal)[1])


def test_a_cut_journal_gives_its_whole_entries(tmp_path: Path) -> None:
    killed_run(tmp_path / "run.rrd", 5, maps=False)
    journal = journal_path(tmp_path / "run.rrd")
    (_, entries), content = read_journal(journal), journal.read_bytes()
    while len(entries) == n_entries(journal, content[:-1]):  # The kill itself came in the middle of an entry.
        content = content[:-1]
    for cut in range(1, 400, 13):
        journal.write_bytes(content[:-cut])
        _, fewer = read_journal(journal)
        assert len(entries) - 2 <= len(fewer) < len(entries)
        assert [entry.packed for entry in fewer] == [entry.packed for entry in entries[: len(fewer)]]


def test_a_journal_with_a_flipped_bit_ends_before_it(tmp_path: Path) -> None:
    killed_run(tmp_path / "run.rrd", 5, maps=False)
    journal = journal_path(tmp_path / "run.rrd")
    (_, entries), content = read_journal(journal), bytearray(journal.read_bytes())
    content[-10] ^= 1
    journal.write_bytes(bytes(content))
    assert len(read_journal(journal)[1]) == len(entries) - 1


def test_exact_columns_reach_the_file_in_blocks(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session(maps=False), block=10)
    exact = [c for c in chunks_of(tmp_path / "run.rrd") if c.entity_path == LOSSLESS]
    assert [c.num_rows for c in exact] == [10, 10, 10]
