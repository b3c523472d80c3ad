"""A run that was read is the run that was written, and goes on like it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.recording.runs import new_run, run_file, session
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_file import RunFile, as_read, read_run_file

METHODS = ("refine", "phys_after", "pir", "sir", "rir", "even", "expl")


def recorded(folder: Path, name: str, problem: Problem | None = None) -> tuple[Run, RunRecord]:
    run = run_file(folder / "a.vfrun", session(name, 2, maps=False), problem)
    return run, read_run_file(folder / "a.vfrun")


@pytest.mark.parametrize("name", METHODS)
def test_it_is_the_run_that_was_recorded(tmp_path: Path, name: str) -> None:
    run, record = recorded(tmp_path, name)
    again = Run.from_record(record, run.problem)
    assert (again.cursor, again.length, again.is_done) == (0, run.length, True)
    assert first_difference(again.iterations, tuple(map(as_read, run.iterations))) is None
    for k in range(run.length + 1):
        ours, theirs = run.state_at(k), again.state_at(k)
        assert first_difference(ours.initial, theirs.initial) is None
        assert first_difference(ours.best, theirs.best) is None
        for one, other in zip(ours.objects, theirs.objects, strict=True):
            assert [len(arm.entries) for arm in one.arms] == [len(arm.entries) for arm in other.arms]
            assert [arm.plays for arm in one.arms] == [arm.plays for arm in other.arms]
            if len(one.arms) > 1:  # Else nobody looks at them.
                np.testing.assert_allclose([a.mean for a in one.arms], [a.mean for a in other.arms], atol=1e-12)


@pytest.mark.parametrize("k", [0, 1, 3])
def test_a_fork_goes_on_as_that_of_the_run_itself(tmp_path: Path, k: int) -> None:
    run, record = recorded(tmp_path, "rir")
    again = Run.from_record(
        record, run.problem, again=lambda: new_run(session("rir", 2, maps=False), box_problem(3, 2))
    )
    pose = run.problem.instances[0].hypotheses[0].T_cam_obj
    ours, theirs = (r.fork(k, edit=(0, 1, pose)) for r in (run, again))
    for r in (ours, theirs):
        r.finish()
    assert first_difference(ours.iterations, theirs.iterations) is None
    assert first_difference(ours.final_state.best, theirs.final_state.best) is None


def test_a_run_that_was_stopped_goes_on_from_its_last_iteration(tmp_path: Path) -> None:
    s, problem = session("rir", 2, maps=False), box_problem(3, 2)
    run = new_run(s, problem, (RunFile(tmp_path / "a.vfrun", s),))
    for _ in range(4):
        run.step()
    again = Run.from_record(read_run_file(tmp_path / "a.vfrun"), problem, again=lambda: new_run(s, problem))
    gone_on = again.fork(4)
    gone_on.finish()
    run.finish()
    assert first_difference(gone_on.iterations, run.iterations) is None


def test_a_run_gives_its_record_at_any_time(tmp_path: Path) -> None:
    s, problem = session("rir", 2, maps=False), box_problem(3, 2)
    file = RunFile(tmp_path / "a.vfrun", s)
    run = new_run(s, problem, (file,))
    for _ in range(4):
        record, read = run.record(s, {}), read_run_file(file.path)
        assert first_difference(record.header, read.header) is None
        assert first_difference(tuple(map(as_read, record.iterations)), read.iterations) is None
        run.step()


def test_a_run_that_was_read_needs_its_data_as_they_were(tmp_path: Path) -> None:
    run, record = recorded(tmp_path, "rir")
    with pytest.raises(InputError, match="without its data"):
        Run.from_record(record, run.problem).fork(1)
    with pytest.raises(InputError, match=r"3 initial poses of box, .* 2"):
        Run.from_record(record, box_problem(2, 2))
    with pytest.raises(InputError, match=r"box \(#1\).* 0/1"):
        Run.from_record(record, box_problem(3, 1))


def test_one_that_ended_early_has_a_note_of_how_far_it_came(tmp_path: Path) -> None:
    s, problem = session(maps=False), box_problem(3, 2)
    for n in (0, 4):
        run = new_run(s, problem, (RunFile(tmp_path / f"{n}.vfrun", s),))
        for _ in range(n):
            run.step()
        notes = Run.from_record(read_run_file(tmp_path / f"{n}.vfrun"), problem).problem.notes
        assert len(notes) == len(problem.notes) + 1
        assert (str(n) if n else "no ") in notes[-1]
    _, whole = recorded(tmp_path, "rir")
    assert Run.from_record(whole, problem).problem.notes == problem.notes
