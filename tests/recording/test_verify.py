"""A recording against a new run: the same, rounding, or another run."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.changing import replace
from tests.fakes import box_problem
from tests.recording.runs import ends_of_messages, new_run, recorded_run, session
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.records import Iteration
from verefine_viz.recording import recorder
from verefine_viz.recording.lossless_log import Entry
from verefine_viz.recording.reader import Recorded, read_recording
from verefine_viz.recording.recording_file import part_path
from verefine_viz.recording.verify import Verification, run_again, verify
from verefine_viz.run.engine import Run
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("processes")


def again(recorded: Recorded) -> Run:
    return new_run(recorded.session, box_problem(3, 2))


@pytest.mark.parametrize("name", ["refine", "pir", "sir", "rir"])
def test_the_same_run_verifies(tmp_path: Path, name: str) -> None:
    recorded_run(tmp_path / "run.rrd", session(name))
    found = verify(tmp_path / "run.rrd", again)
    assert (found.difference, found.ends_early, found.n_compared) == (None, False, found.n_planned)
    assert found.in_words == f"no difference in {found.n_planned} iterations"


def test_a_run_without_iterations_is_not_called_the_same() -> None:
    assert Verification(0, None, 0, True).in_words.startswith("there is nothing to compare")


def record_changed(
    path: Path, monkeypatch: pytest.MonkeyPatch, k: int, change: Callable[[Iteration], Iteration]
) -> None:
    def changed(iteration: Iteration, errors: Float) -> Entry:
        return Entry(change(iteration) if iteration.index == k else iteration, errors)

    with monkeypatch.context() as patched:
        patched.setattr(recorder, "Entry", changed)
        recorded_run(path, session())


def moved(iteration: Iteration, x: Callable[[float], float]) -> Iteration:
    """The same with x of its third stage changed."""
    stages = list(iteration.stages)
    T = stages[2].T_cam_obj.copy()
    T[0, 3] = x(T[0, 3])
    stages[2] = replace(stages[2], T_cam_obj=T)
    return replace(iteration, stages=tuple(stages))


def next_number(x: float) -> float:
    return float(np.nextafter(x, 1))


def test_one_bit_of_a_pose_is_found_and_told_from_a_real_difference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record_changed(tmp_path / "run.rrd", monkeypatch, 17, lambda i: moved(i, next_number))
    found = verify(tmp_path / "run.rrd", again)
    told = re.fullmatch(
        r"iteration 17: stages\[2\]\.T_cam_obj\[0, 3\]: (\S+) against (\S+), by (\S+); only last digits differ, in all "
        r"30 iterations by (\S+) at most, and everything else is the same: in effect it is the same run; another state "
        r"of the program, or another machine, computes last digits differently \(same versions\)",
        found.difference or "",
    )
    assert told
    recorded, now, by, most = map(float, told.groups())
    assert recorded == next_number(now)
    assert by == pytest.approx(recorded - now, rel=0.05)
    assert 0 < most < 1e-15
    assert (found.n_compared, found.ends_early) == (16, False)
    assert found.in_words.startswith("differs, recorded against now: iteration 17: ")


def test_a_real_difference_is_not_called_rounding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record_changed(tmp_path / "run.rrd", monkeypatch, 4, lambda i: moved(i, lambda x: x + 2e-5))
    found = verify(tmp_path / "run.rrd", again).difference
    assert found is not None
    assert re.fullmatch(r"iteration 4: stages\[2\]\.T_cam_obj\[0, 3\]: \S+ against \S+, by 2e-05", found)


def test_last_digits_that_lead_to_another_run_are_not_called_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def change(iteration: Iteration) -> Iteration:
        return replace(moved(iteration, next_number), accepted="simulated")

    record_changed(tmp_path / "run.rrd", monkeypatch, 5, change)
    found = verify(tmp_path / "run.rrd", again).difference
    assert found is not None
    assert found.startswith("iteration 5: stages[2].T_cam_obj[0, 3]: ")
    assert "it begins with last digits and leads to more, iteration 5: accepted: 'simulated' against 'refined'" in found
    assert "same run" not in found


@pytest.mark.parametrize(
    ("k", "change", "named"),
    [
        (1, lambda i: replace(i, accepted="simulated"), "accepted"),
        (30, lambda i: replace(i, best=replace(i.best, arm=7)), "best.arm"),
        (8, lambda i: replace(i, arm=2), "arm"),
    ],
)
def test_other_changes_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, k: int, change: Callable[[Iteration], Iteration], named: str
) -> None:
    record_changed(tmp_path / "run.rrd", monkeypatch, k, change)
    found = verify(tmp_path / "run.rrd", again).difference
    assert found is not None
    assert found.startswith(f"iteration {k}: {named}")


def test_a_recording_longer_than_the_run_is_found(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session(iterations=5))
    found = verify(tmp_path / "run.rrd", lambda r: new_run(session(iterations=4), box_problem(3, 2))).difference
    assert found is not None
    assert found.startswith("iteration 13: ")


def test_a_recording_whose_writer_was_killed_is_said_to_end_early(tmp_path: Path) -> None:
    s, problem = session(maps=False), box_problem(3, 2)
    writer = recorder.Recorder(tmp_path / "run.rrd", s, problem)
    run = new_run(s, problem, (writer,))
    for _ in range(7):
        run.step()
    found = verify(tmp_path / "run.rrd", again)
    run.close()
    assert found.ends_early
    assert "ended early, after 7 of 30 iterations" in found.in_words
    assert "the same up to iteration 7" in found.in_words


@given(share=st.floats(0.5, 0.99), more=st.integers(1, 15))
@settings(max_examples=10, deadline=None)
def test_a_recording_that_was_cut_is_said_to_end_early(tmp_path_factory: pytest.TempPathFactory, share, more) -> None:
    folder = tmp_path_factory.mktemp("cut")
    recorded_run(folder / "run.rrd", session(maps=False), block=3)
    content = (folder / "run.rrd").read_bytes()
    # A little into the head of a message, which rerun takes for the end, and anywhere.
    head, at = max(k for k in ends_of_messages(content) if k <= share * len(content)) + more, int(share * len(content))
    for k in (head, at):
        (folder / "cut.rrd").write_bytes(content[:k])
        found = verify(folder / "cut.rrd", again)
        assert found.ends_early
        assert found.in_words.startswith("ended early")


def test_a_recording_that_was_cut_where_a_message_ends_is_said_to_end_early(tmp_path: Path) -> None:
    s, problem = session(maps=False, iterations=3), box_problem(3, 2)
    writer = recorder.Recorder(tmp_path / "run.rrd", s, problem, block=3)
    new_run(s, problem, (writer,)).finish()
    content = (tmp_path / "run.rrd").read_bytes()
    ends = [end for end in ends_of_messages(content) if end < 0.98 * len(content)]
    n_read = set()
    for end in ends[len(ends) // 4 :]:
        (tmp_path / "cut.rrd").write_bytes(content[:end])
        recorded = read_recording(tmp_path / "cut.rrd")
        assert not recorded.is_complete
        n_read.add(len(recorded.entries))
    assert len(n_read) > 3
    assert verify(tmp_path / "cut.rrd", again).in_words.startswith("ended early, after 18 of 18 iterations")


def test_a_difference_matters_more_than_an_early_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record_changed(tmp_path / "run.rrd", monkeypatch, 2, lambda i: replace(i, accepted="mixed"))
    (tmp_path / "run.rrd").rename(part_path(tmp_path / "run.rrd"))
    found = verify(tmp_path / "run.rrd", again).difference
    assert found is not None
    assert found.startswith("iteration 2: accepted")


def test_another_version_is_named_as_the_reason_of_rounding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder, "versions", lambda session: {"numpy": "0.0.1"})
    record_changed(tmp_path / "run.rrd", monkeypatch, 3, lambda i: moved(i, next_number))
    found = verify(tmp_path / "run.rrd", again).difference
    assert found is not None
    assert "in effect it is the same run; recorded with numpy 0.0.1 (here " in found
    assert found.endswith("), and other versions compute last digits differently")


def test_another_version_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder, "versions", lambda session: {"numpy": "0.0.1"})
    record_changed(tmp_path / "run.rrd", monkeypatch, 3, lambda i: replace(i, accepted="mixed"))
    found = verify(tmp_path / "run.rrd", again).difference
    assert found is not None
    assert "recorded with numpy 0.0.1 (here " in found


def test_objects_that_the_data_no_longer_have_are_named_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = box_problem(3, 2)
    recorded_run(tmp_path / "run.rrd", session(), problem)
    kept, gone = problem.targets
    changed = replace(problem, instances=(kept.instance,), left_out=(gone.left_out("its mask is missing"),))
    monkeypatch.setattr(Toolbox, "problem", lambda self, frame: changed)
    said = r"frame 0/1 of the data no longer has instance 1, which was there .* box: its mask is missing$"
    with pytest.raises(InputError, match=said):
        run_again(read_recording(tmp_path / "run.rrd"))
