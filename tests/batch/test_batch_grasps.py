"""``batch --grasp``: outcomes in the tables and the report, the same for any number of workers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.batch.frames import batch_here, make_frames, write_session
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.session_check import check
from verefine_viz.batch.solve_frame import solve_frame
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox


@pytest.mark.usefixtures("processes", "long_run")
def test_outcomes_are_the_same_for_any_number_of_workers(tmp_path: Path) -> None:
    made = make_frames(tmp_path / "data", 2)
    poses = {"rotation_deg": 0.0, "translation_mm": 0.0, "max_per_object": 1}
    method = {"name": "refine", "refiner": "identity", "iterations": 1}
    session = write_session(tmp_path, made, hypotheses=poses, method=method)
    for n in (1, 2):
        done = batch_here(session, tmp_path / str(n), "--grasp", "--workers", n)
        assert done.returncode == 0, done.stderr
    one, two = (read_batch(tmp_path / n).rows for n in ("1", "2"))
    outcomes = [(r.frame, r.instance_id, r.grasp, r.grasp_ground_truth) for r in one]
    assert outcomes == [(r.frame, r.instance_id, r.grasp, r.grasp_ground_truth) for r in two]
    # The answers are the ground truth.
    assert all(grasp == ground_truth != "" for _, _, grasp, ground_truth in outcomes)
    assert "answers = true" in (tmp_path / "1" / "session.toml").read_text()


def test_a_folder_without_grasps_is_refused_before_the_first_frame(tmp_path: Path) -> None:
    grasp = {"answers": True, "folder": str(tmp_path / "none")}
    session = load_session(write_session(tmp_path, make_frames(tmp_path / "data", 1), grasp=grasp))
    with pytest.raises(InputError, match=str(tmp_path / "none")):
        check(session)


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("pose", [transform(np.eye(3), [0.0, 0.0, 0.4]), np.diag([1.0, 1.0, 2.0, 1.0])])
def test_a_file_that_holds_no_grasps_of_an_object_is_noted_and_the_answer_stays(
    tmp_path: Path, pose: np.ndarray
) -> None:
    made = make_frames(tmp_path / "data", 1)
    np.save(tmp_path / "obj_000005.npy", pose[None])
    session = write_session(
        tmp_path, made, method={"name": "refine", "refiner": "identity", "iterations": 1},
        grasp={"answers": True, "folder": str(tmp_path)},
    )  # fmt: skip
    result = solve_frame(Toolbox(load_session(session)), "7/0", tmp_path).end
    assert {row.status for row in result.answers} == {"ok"}
    refused = [row for row in result.answers if row.obj_id == 5]
    assert refused
    assert {row.grasp for row in refused} == {""}
    assert any(note.startswith("no grasp of ") for note in result.notes)
    assert not any("\n" in note for note in result.notes)
