"""A recording played back is the run that was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.recording.runs import new_run, recorded_run, session
from verefine_viz.core.errors import InputError
from verefine_viz.recording.lossless_log import as_recorded
from verefine_viz.recording.playback import played
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.compare import aligned, departures

pytestmark = pytest.mark.usefixtures("processes")

METHODS = ("refine", "phys_after", "pir", "sir", "rir", "even", "expl")


@pytest.mark.parametrize("name", METHODS)
def test_it_is_the_run_that_was_recorded(tmp_path: Path, name: str) -> None:
    problem = box_problem(3, 2)
    run = recorded_run(tmp_path / "run.rrd", session(name, 2, maps=False), problem)
    recorded = read_recording(tmp_path / "run.rrd")
    again = played(recorded, problem)
    assert (again.cursor, again.length, again.is_done) == (0, run.length, True)
    assert departures(run, again, aligned(run.iterations, again.iterations)) == (None, None)
    for k in range(run.length + 1):
        before, after = run.best_at(k), again.best_at(k)
        assert (
            first_difference([best.T_cam_obj for best in before.values()], [best.T_cam_obj for best in after.values()])
            is None
        )
    for ours, theirs in zip(again.iterations, run.iterations, strict=True):
        assert first_difference(ours, as_recorded(theirs)) is None
    for k in range(run.length + 1):
        ours, theirs = run.state_at(k).objects, again.state_at(k).objects
        for one, other in zip(ours, theirs, strict=True):
            assert [len(arm.entries) for arm in one.arms] == [len(arm.entries) for arm in other.arms]
            assert [arm.plays for arm in one.arms] == [arm.plays for arm in other.arms]
            if len(one.arms) > 1:  # Else nobody looks at them.
                np.testing.assert_allclose([a.mean for a in one.arms], [a.mean for a in other.arms], atol=1e-12)


def test_a_recording_cannot_be_edited_or_continued(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session("sir", 2, maps=False))
    again = played(read_recording(tmp_path / "run.rrd"), box_problem(3, 2))
    again.seek(again.length)
    with pytest.raises(InputError, match=r"run\.rrd ends here"):
        again.step()
    with pytest.raises(InputError, match=r"run\.rrd is a recording and stays as it is"):
        again.fork(1, None, (0, 0, np.eye(4)))


def test_data_that_changed_since_are_reported(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session("sir", 2, maps=False))
    recorded = read_recording(tmp_path / "run.rrd")
    with pytest.raises(InputError, match="made from 3 initial poses of 0_box, its session now gives 2"):
        played(recorded, box_problem(2, 2))
    with pytest.raises(InputError, match="made of 1_box, which frame 0/1 does not hold"):
        played(recorded, box_problem(3, 1))


@pytest.mark.parametrize(("n", "said"), [(0, "no iterations are"), (1, "1 iteration is"), (4, "4 iterations are")])
def test_one_that_ended_early_says_so(tmp_path: Path, n: int, said: str) -> None:
    s, problem = session(maps=False), box_problem(3, 2)
    run = new_run(s, problem, (Recorder(tmp_path / "run.rrd", s, problem),))
    for _ in range(n):
        run.step()
    notes = played(read_recording(tmp_path / "run.rrd"), problem).problem.notes
    assert notes[-1] == f"the recording ended early (it was stopped or cut off); {said} in it"
    run.finish()
    assert played(read_recording(tmp_path / "run.rrd"), problem).problem.notes == problem.notes
