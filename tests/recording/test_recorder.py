from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.changing import replace
from tests.fakes import box_problem
from tests.recording.runs import new_run, recorded_run, session
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.methods.registry import METHOD_NAMES
from verefine_viz.recording.playback import played
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import journal_path, part_path
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.session_file import load_session

pytestmark = pytest.mark.usefixtures("processes")


@pytest.mark.parametrize("name", METHOD_NAMES)
def test_every_bit_of_every_iteration_comes_back(tmp_path: Path, name: str) -> None:
    run = recorded_run(tmp_path / "run.rrd", session(name, maps=False))
    recorded = read_recording(tmp_path / "run.rrd")
    assert len(recorded.iterations) == len(run.iterations)
    for back, iteration in zip(recorded.iterations, run.iterations, strict=True):
        assert first_difference(replace(back, path=None), replace(iteration, path=None)) is None


@pytest.mark.parametrize("name", ["sir", "vf_depth"])
def test_the_simulated_path_comes_back_in_single_precision(tmp_path: Path, name: str) -> None:
    run = recorded_run(tmp_path / "run.rrd", session(name, maps=False))
    for back, iteration in zip(read_recording(tmp_path / "run.rrd").iterations, run.iterations, strict=True):
        ours, theirs = back.path, iteration.path
        assert ours is not None
        assert theirs is not None
        np.testing.assert_array_equal(ours.Ts_cam_obj, theirs.Ts_cam_obj.astype(np.float32))
        assert len(ours.contacts) == len(theirs.contacts)
        assert first_difference(ours.contacts[-1], theirs.contacts[-1]) is None


@pytest.mark.parametrize("block", [1, 2, 7, 1000])
def test_blocks_change_nothing(tmp_path: Path, block: int) -> None:
    s = session(maps=False)
    recorded_run(tmp_path / "a.rrd", s, block=25)
    recorded_run(tmp_path / "b.rrd", s, block=block)
    a, b = read_recording(tmp_path / "a.rrd"), read_recording(tmp_path / "b.rrd")
    assert first_difference(a.iterations, b.iterations) is None


def test_a_finished_recording_is_one_file(tmp_path: Path) -> None:
    recorded_run(tmp_path / "folder" / "run.rrd")
    assert [p.name for p in (tmp_path / "folder").iterdir()] == ["run.rrd"]


def test_recorder_does_not_change_the_run(tmp_path: Path) -> None:
    problem = box_problem(3, 2)
    watched = recorded_run(tmp_path / "run.rrd", session(), problem)
    alone = new_run(session(), problem)
    alone.finish()
    assert first_difference(watched.iterations, alone.iterations) is None


def test_properties_let_it_run_again(tmp_path: Path) -> None:
    s = session("sir")
    recorded_run(tmp_path / "run.rrd", s)
    recorded = read_recording(tmp_path / "run.rrd")
    assert recorded.session == s
    assert (recorded.title, recorded.frame) == ("boxes", "0/1")
    assert {"python", "numpy", "numba", "pybullet"} <= set(recorded.versions)
    (tmp_path / "session.toml").write_text(recorded.session_toml, encoding="utf-8")
    assert load_session(tmp_path / "session.toml") == s


def test_initial_scores_and_errors_are_recorded(tmp_path: Path) -> None:
    run = recorded_run(tmp_path / "run.rrd")
    recorded = read_recording(tmp_path / "run.rrd")
    first = run._states[0].initial[0]
    assert first is not None
    assert recorded.layout.branches[0].initial_scores == tuple(first.score)
    assert first_difference(played(recorded, run.problem).state_at(0).initial[0], first) is None
    last = run.iterations[-1]
    T_gt = run.problem.instances[-1].T_cam_obj_gt
    assert T_gt is not None
    translation_mm = 1e3 * np.linalg.norm(last.accepted_stage.T_cam_obj[:3, 3] - T_gt[:3, 3])
    assert recorded.entries[-1].errors[1] == pytest.approx(translation_mm)


@pytest.mark.parametrize("symmetric", [True, False])
def test_recorded_errors_are_those_of_the_evaluation(tmp_path: Path, symmetric: bool) -> None:
    problem = box_problem(3)
    if symmetric:
        half_turn = transform(axis_angle([0, 0, 1], np.pi), [0, 0, 0])
        problem = replace(problem, models={1: replace(problem.models[1], symmetries=np.stack([np.eye(4), half_turn]))})
        turned = tuple(replace(h, T_cam_obj=h.T_cam_obj @ half_turn) for h in problem.instances[0].hypotheses)
        problem = replace(problem, instances=(replace(problem.instances[0], hypotheses=turned),))
    run = recorded_run(tmp_path / "run.rrd", session("sir"), problem)
    T_gt = problem.instances[0].T_cam_obj_gt
    assert T_gt is not None
    for entry, iteration in zip(read_recording(tmp_path / "run.rrd").entries, run.iterations, strict=True):
        kept = pose_errors(problem.models[1], iteration.accepted_stage.T_cam_obj, T_gt)
        best = pose_errors(problem.models[1], iteration.best.T_cam_obj, T_gt)
        assert entry.errors == pytest.approx([kept.rotation_deg, kept.translation_mm, best.add_s_mm], abs=1e-5)


def test_a_run_that_is_left_early_keeps_what_it_had(tmp_path: Path) -> None:
    s, problem = session(), box_problem(3)
    run = new_run(s, problem, (Recorder(tmp_path / "run.rrd", s, problem),))
    for _ in range(4):
        run.step()
    run.close()
    assert len(read_recording(tmp_path / "run.rrd").entries) == 4


def test_unwritable_folder_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    s, problem = session(), box_problem()
    with pytest.raises(InputError, match=r"cannot write the recording .*run\.rrd"):
        new_run(s, problem, (Recorder(tmp_path / "file" / "run.rrd", s, problem),))


def test_hostile_names_stay_in_their_branch(tmp_path: Path) -> None:
    problem = box_problem(2)
    hostile = replace(problem.models[1], name="../<script>alert(1)</script> /a/b mug")
    problem = replace(problem, models={1: hostile}, title="<b>x</b>")
    recorded_run(tmp_path / "run.rrd", problem=problem)
    branch = read_recording(tmp_path / "run.rrd").layout.branches[0].name
    assert branch == "0_script_alert_1_script_a_b_mug"


def test_nothing_is_left_open_when_the_run_never_starts(tmp_path: Path) -> None:
    Recorder(tmp_path / "run.rrd", session(), box_problem()).close()
    assert not part_path(tmp_path / "run.rrd").exists()
    assert not journal_path(tmp_path / "run.rrd").exists()
