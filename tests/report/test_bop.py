"""Average recall by frame and object."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.batch.frames import SCENE_ID, make_frames
from tests.report.runs import row, write_run
from tests.scenes.bop_folder import box_ply, make
from verefine_viz.batch.index import read_batch
from verefine_viz.core.errors import InputError
from verefine_viz.evaluation.bop_scores import bop_scores
from verefine_viz.evaluation.ground_truth import BopGroundTruth, visible_targets
from verefine_viz.evaluation.pose_table import pose_table
from verefine_viz.report.bop_recalls import bop_recalls, run_rows
from verefine_viz.report.group_numbers import compare
from verefine_viz.report.groups import sections_of
from verefine_viz.scenes.bop import BopDataset


def test_parts_make_the_score_of_the_whole(tmp_path: Path) -> None:
    made = make_frames(tmp_path / "data", 3)
    made.edit("scene_gt_info.json", lambda info: info.update({"1": [{"visib_fract": 0.05}] * 3}))
    session = {"scene": {"source": "bop", "dataset": str(made.root)}}
    rows = [row(im_id, 1, scene_id=SCENE_ID, obj_id=5) for im_id in range(3)]
    T_gt = np.array(made.problem.instances[1].T_cam_obj_gt)
    T_gt[2, 3] += 0.004
    runs = [
        read_batch(write_run(tmp_path / name, mine, {**session, "method": {"name": name}}, T_gt))
        for name, mine in (("rir", rows), ("sir", rows[1:]))
    ]
    found = bop_recalls(runs)
    assert "There is no models_eval" in found.note
    asked = {(folder.name, frame) for folder, frame, _ in found.by_place}
    # Nothing is asked for in a frame in which nothing is seen.
    assert asked == {("rir", "7/0"), ("rir", "7/2"), ("sir", "7/2")}

    ground_truth = BopGroundTruth(BopDataset(made.root, "test"))
    (only,) = sections_of(runs)
    for line, frames in zip(compare(only, found).lines, ([0, 1, 2], [1, 2]), strict=True):
        targets = visible_targets(ground_truth, [(SCENE_ID, im_id) for im_id in frames])
        table = pose_table("own", list(run_rows(line.group.runs[0], [f"{SCENE_ID}/{im_id}" for im_id in frames])))
        (scores,) = bop_scores([table], ground_truth, targets, "localization")
        assert scores.recalls is not None
        assert 0 < scores.recalls.ar < 1 / 3
        assert line.numbers["ar"].value == pytest.approx(scores.recalls.ar)


def test_a_mesh_in_another_unit_is_noted(tmp_path: Path) -> None:
    made = make(tmp_path / "data")
    (made.root / "models" / "obj_000005.ply").write_text(box_ply(made.problem, unit_m=1.0))
    T_gt = made.problem.instances[1].T_cam_obj_gt
    session = {"scene": {"source": "bop", "dataset": str(made.root), "objects": [5]}}
    found = bop_recalls([read_batch(write_run(tmp_path / "run", [row(3, 1, scene_id=7, obj_id=5)], session, T_gt))])
    assert {ar for _, ar in found.by_place.values()} == {1.0}
    assert all(fact in found.note for fact in ("obj_000005.ply", "0.1414 mm", "141.4 mm"))


def test_answers_whose_run_file_is_lost_are_not_scored_as_missing(tmp_path: Path) -> None:
    run = read_batch(write_run(tmp_path / "run", [row(0), row(1)]))
    file = run.folder / "runs" / "000001_000001.vfrun"
    file.write_bytes(file.read_bytes()[:-1] + b"x")
    with pytest.raises(InputError, match=file.name):
        list(run_rows(run, ("1/0", "1/1")))
    file.unlink()
    with pytest.raises(InputError, match="1/1"):
        list(run_rows(run, ("1/0", "1/1")))
