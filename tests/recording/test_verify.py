"""A recording against a new run: the same, rounding, or another run."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.changing import replace
from tests.fakes import box_problem
from tests.recording.runs import ending, new_run, recorded_run, run_file, session
from verefine_viz.core.errors import InputError
from verefine_viz.core.records import Iteration
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.verify import run_again, verify
from verefine_viz.run import run_header
from verefine_viz.run.engine import Run
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_file import RunFile, read_run_file, write_record
from verefine_viz.run.run_header import session_of
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("processes")


def again(recorded: RunRecord) -> Run:
    return new_run(session_of(recorded.header), box_problem(3, 2))


def test_the_same_run_verifies(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session())
    found = verify(tmp_path / "run.rrd", again)
    assert (found.difference, found.ends_early, found.n_compared) == (None, False, found.n_planned)
    assert found.text == f"no difference in {found.n_planned} iterations"


class Changing(RunFile):
    """Writes a run whose iteration ``k`` is changed."""

    def __init__(self, path: Path, k: int, change: Callable[[Iteration], Iteration]) -> None:
        super().__init__(path, session())
        self._k, self._change = k, change

    def append(self, iteration: Iteration) -> None:
        super().append(self._change(iteration) if iteration.index == self._k else iteration)


def record_changed(folder: Path, k: int, change: Callable[[Iteration], Iteration], is_finished: bool = True) -> Path:
    file = Changing(folder / "run.vfrun", k, change)
    run = new_run(session(), box_problem(3, 2), (file,))
    run.finish()
    if is_finished:
        file.finish(ending(run))
    return file.path


def moved(iteration: Iteration, x: Callable[[float], float]) -> Iteration:
    """The same with x of its third stage changed."""
    stages = list(iteration.stages)
    T = stages[2].T_cam_obj.copy()
    T[0, 3] = x(T[0, 3])
    stages[2] = replace(stages[2], T_cam_obj=T)
    return replace(iteration, stages=tuple(stages))


def next_number(x: float) -> float:
    return float(np.nextafter(x, 1))


def test_one_bit_of_a_pose_is_found_and_told_from_a_real_difference(tmp_path: Path) -> None:
    path = record_changed(tmp_path, 17, lambda i: moved(i, next_number))
    found = verify(path, again)
    told = re.match(
        r"iteration 17: stages\[2\]\.T_cam_obj\[0, 3\]: (\S+) against (\S+), by (\S+); .* all 30 iterations by (\S+) .*"
        "same run; ",
        found.difference or "",
    )
    assert told
    recorded, now, by, most = map(float, told.groups())
    assert recorded == next_number(now)
    assert by == pytest.approx(recorded - now, rel=0.05)
    assert 0 < most < 1e-15
    assert (found.n_compared, found.ends_early) == (16, False)
    assert found.difference in found.text


@pytest.mark.parametrize(
    ("k", "change", "named"),
    [
        (1, lambda i: replace(i, accepted="simulated"), "accepted"),
        (8, lambda i: replace(i, arm=2), "arm"),
        (30, lambda i: replace(i, best=replace(i.best, arm=(i.best.arm + 1) % 3)), "best.arm"),
        (4, lambda i: moved(i, lambda x: x + 2e-5), r"stages\[2\]\.T_cam_obj\[0, 3\]: \S+ against \S+, by 2e-05$"),
    ],
)
@pytest.mark.parametrize("is_finished", [True, False])
def test_a_real_difference_is_named_and_not_called_rounding(
    tmp_path: Path, k: int, change: Callable[[Iteration], Iteration], named: str, is_finished: bool
) -> None:
    path = record_changed(tmp_path, k, change, is_finished)
    found = verify(path, again).difference
    assert found is not None
    assert re.match(f"iteration {k}: {named}", found)
    assert "same run" not in found


def changed(record: RunRecord, **fields: Any) -> RunRecord:
    """The record with something else about its first object."""
    first, *others = record.header.objects
    return replace(record, header=replace(record.header, objects=(replace(first, **fields), *others)))


def test_what_a_run_began_from_and_its_answers_are_compared_too(tmp_path: Path) -> None:
    run_file(tmp_path / "run.vfrun", session(maps=False))
    record = read_run_file(tmp_path / "run.vfrun")
    first, end = record.header.objects[0], record.end
    assert end is not None
    T = first.hypotheses[0].T_cam_obj.copy()
    T[0, 3] += 1e-3
    other = (replace(first.hypotheses[0], T_cam_obj=T), *first.hypotheses[1:])
    rescored = (replace(first.initial[0], score=0.9), *first.initial[1:])
    answers = (replace(end.answers[0], score=0.9),)
    for written, where in (
        (record, ""),
        (changed(record, diameter_m=0.2), "the start: objects[0].diameter_m: "),
        (changed(record, T_cam_obj_gt=T), "the start: objects[0].T_cam_obj_gt["),
        (changed(record, T_cam_obj_gt=None), "the start: objects[0].T_cam_obj_gt: "),
        (changed(record, hypotheses=other), "the start: objects[0].hypotheses[0].T_cam_obj[0, 3]: "),
        (changed(record, initial=rescored), "the start: objects[0].initial[0].score: 0.9 against "),
        (changed(record, initial=()), "the start: objects[0].initial: 0 entries against 3"),
        (changed(record, name="cup"), "the start: objects[0].name: 'cup' against 'box'"),
        (replace(record, header=replace(record.header, T_map_cam=np.eye(4))), "the start: T_map_cam: "),
        (replace(record, end=replace(end, answers=answers)), "the answers: answers[0].score: "),
        (replace(record, end=replace(end, notes=("so",))), "the answers: notes: 1 entries against 0"),
        (replace(record, end=replace(end, seconds=99.0, stages_ms={"read": 1.0})), ""),
    ):
        write_record(tmp_path / "b.vfrun", written)
        found = verify(tmp_path / "b.vfrun", again, lambda run, recorded: ending(run)).difference
        assert (found or "").startswith(where), (where, found)
        assert (found is None) == (not where), (where, found)


def test_a_recording_longer_than_the_run_is_found(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session(iterations=5))
    found = verify(tmp_path / "run.rrd", lambda r: new_run(session(iterations=4), box_problem(3, 2))).difference
    assert found is not None
    assert found.startswith("iteration 13: ")


def test_last_digits_that_lead_to_another_run_are_not_called_the_same(tmp_path: Path) -> None:
    def change(iteration: Iteration) -> Iteration:
        return replace(moved(iteration, next_number), accepted="simulated")

    found = verify(record_changed(tmp_path, 5, change), again).difference
    assert found is not None
    assert found.startswith("iteration 5: stages[2].T_cam_obj[0, 3]: ")
    assert "iteration 5: accepted: 'simulated' against 'refined'" in found
    assert "same run" not in found


def test_a_recording_whose_writer_was_killed_is_said_to_end_early(tmp_path: Path) -> None:
    s, problem = session(maps=False), box_problem(3, 2)
    run = new_run(s, problem, (RunFile(tmp_path / "run.vfrun", s),))
    for _ in range(7):
        run.step()
    found = verify(tmp_path / "run.vfrun", again)
    assert (found.ends_early, found.difference, found.n_compared, found.n_planned) == (True, None, 7, 30)
    assert "7 iterations are in it, of 30" in found.text


def test_another_version_is_named_as_the_reason_of_rounding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_header, "versions", lambda weights: {"numpy": "0.0.1"})
    found = verify(record_changed(tmp_path, 3, lambda i: moved(i, next_number)), again).difference
    assert found is not None
    assert "same run; recorded with numpy 0.0.1 (here " in found


def test_objects_that_the_data_no_longer_have_are_named_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = box_problem(3, 2)
    recorded_run(tmp_path / "run.rrd", session(), problem)
    kept, gone = problem.targets
    changed = replace(problem, instances=(kept.instance,), left_out=(gone.left_out("its mask is missing"),))
    monkeypatch.setattr(Toolbox, "problem", lambda self, frame: changed)
    with pytest.raises(InputError, match=r"frame 0/1 .* instance 1, .*: its mask is missing$"):
        run_again(read_recording(tmp_path / "run.rrd"))
