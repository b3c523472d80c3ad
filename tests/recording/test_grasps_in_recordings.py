"""Grasps of a run's answers in its recording: on a timeline of their own, both sides, and never in the way of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.fakes import FakeVerifier, box_problem
from tests.recording.runs import new_run, session
from verefine_viz.grasping.grasp_answer import AnswerGrasps, answer_grasps
from verefine_viz.recording import entities
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.run.run_file import RunFile

pytestmark = pytest.mark.usefixtures("processes")


def recorded(path: Path, with_grasps: bool) -> AnswerGrasps:
    """Two boxes, solved, grasped and recorded."""
    s, problem = session(maps=False), box_problem(3, 2)
    made: list[AnswerGrasps] = []

    def grasps_of(state: object) -> AnswerGrasps:
        poses = [i.T_cam_obj_gt for i in problem.instances]
        made.append(answer_grasps(problem, [poses[0], None], s.grasp))
        return made[-1]

    recorder = Recorder(path, s, problem, lambda _: FakeVerifier(), grasps_of=grasps_of if with_grasps else None)
    file = RunFile(path.with_suffix(".vfrun"), s)
    new_run(s, problem, (recorder, file)).finish()
    recorder.close(file.path.read_bytes())
    return made[0] if made else AnswerGrasps()


def test_gripper_objects_contacts_and_outcome_are_recorded(tmp_path: Path) -> None:
    grasps = recorded(tmp_path / "run.rrd", with_grasps=True)
    (pair,) = grasps.pairs.values()
    path = pair.answer.path
    assert path is not None
    mine = [c for c in chunks_of(tmp_path / "run.rrd") if c.entity_path.startswith(entities.GRASP)]
    rows: dict[str, int] = {}
    for chunk in mine:
        if not chunk.is_static:
            assert chunk.timeline_names == [entities.GRASP_TIMELINE]
            rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    for side in ("answer", "ground_truth"):
        origin = entities.grasp_side(side)
        # A row with the mesh, and one per moment.
        assert rows[f"{origin}/gripper/palm"] == rows[f"{origin}/objects/1_box"] == 1 + path.n_moments
        assert rows[f"{origin}/contacts"] == path.n_moments
        assert rows[f"{origin}/end"] == 1
        assert rows[f"{origin}/grasps"] == 2, "until the gripper closes"
    assert rows[f"{entities.GRASP}/stage"] == len(set(path.stages))
    said = next(c for c in mine if c.entity_path == entities.GRASP_ENDS)
    assert f"| 0_box | {pair.answer.is_free.sum()} | success | success |" in str(said.to_record_batch().to_pylist())


def test_a_run_is_recorded_as_without_grasps(tmp_path: Path) -> None:
    recorded(tmp_path / "with.rrd", with_grasps=True)
    recorded(tmp_path / "without.rrd", with_grasps=False)
    one, other = read_recording(tmp_path / "with.rrd"), read_recording(tmp_path / "without.rrd")
    assert len(one.iterations) == len(other.iterations)
    for a, b in zip(one.iterations, other.iterations, strict=True):
        np.testing.assert_array_equal(a.best.T_cam_obj, b.best.T_cam_obj)
    assert not any(c.entity_path.startswith(entities.GRASP) for c in chunks_of(tmp_path / "without.rrd"))
