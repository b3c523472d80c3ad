"""Matching, recalls and precision against the official toolkit's numbers and against loops."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.evaluation import reference, vectors
from tests.evaluation.vectors import Vectors
from verefine_viz.core.errors import InputError
from verefine_viz.evaluation.averages import DETECTION_THRESHOLDS as DETECTION_THRESHOLDS
from verefine_viz.evaluation.averages import IGNORED, THRESHOLDS, Detections, Tally, average_precision, average_recalls
from verefine_viz.evaluation.matched_estimates import match_poses, match_thresholds
from verefine_viz.evaluation.pose_table import read_pose_table


@pytest.fixture(scope="module")
def official(shared_data: Path) -> Vectors:
    return vectors.read(shared_data / "bop_vectors")


def test_matching(official: Vectors) -> None:
    assert len(official.json["matching"]) == 21
    for k, case in enumerate(official.json["matching"]):
        estimates = sorted(case["errs"], key=lambda e: e["score"], reverse=True)
        if case["max_ests_count"] > 0:
            estimates = estimates[: case["max_ests_count"]]
        valid = np.array(case["gt_valid"])
        errors = np.array([[[float(x) for x in e["errors"][str(g)]] for g in range(len(valid))] for e in estimates])
        errors = errors.reshape(len(estimates), len(valid), len(case["error_ths"]))
        matched = match_poses(errors, np.array(case["error_ths"], dtype=np.float64), valid)
        ours = [
            {"est_id": e["est_id"], "gt_id": int(g), "error": [float(x) for x in e["errors"][str(int(g))]]}
            for e, g in zip(estimates, matched, strict=True)
            if g >= 0
        ]
        assert ours == case["matches"], k


def test_recalls(official: Vectors) -> None:
    for case in official.json["localization_scores"]:
        assert case["n_top"] == -1
        tally, theirs = Tally(), case["scores"]
        for match in case["matches"]:
            found = np.array([[int(match["valid"] and match["est_id"] != -1)]])
            tally.add(match["scene_id"], match["obj_id"], int(match["valid"]), found)
        n_targets, recall = tally.shares()
        assert n_targets == theirs["targets_count"]
        assert recall[0, 0] == theirs["recall"]
        for obj_id, expected in theirs["obj_recalls"].items():
            assert tally.shares(obj_id=int(obj_id))[1][0, 0] == expected
        for scene_id, expected in theirs["scene_recalls"].items():
            assert tally.shares(scene_id=int(scene_id))[1][0, 0] == expected


def test_results_files(official: Vectors, tmp_path: Path) -> None:
    cases = official.json["csv_format"]
    assert len(cases) == 20
    for name, case in cases.items():
        path = tmp_path / f"{name}_x-test.csv"
        path.write_bytes(case["text"].encode())
        if case["ok"]:
            assert len(read_pose_table(path)) == case["rows"], name
            continue
        try:
            table = read_pose_table(path)
        except InputError as error:
            text = str(error)
            assert str(path) in text
        else:  # A row that it refuses is left out, or its time is; that it refuses the file is said.
            text = " ".join(table.notes)
            assert f"{path.name}" in text
            assert "the official toolkit refuses such a file" in text
        assert "\n" not in text
        assert ("line " in text) != (case["msg"] == "Empty results"), name


def test_poses_are_read_digit_by_digit(official: Vectors, tmp_path: Path) -> None:
    path = tmp_path / "x_x-test.csv"
    path.write_text("1,2,3,0.5,1 2 3 4 5 6 7 8 9e-1,-1 nan inf,-1\n")
    read = read_pose_table(path)
    assert read.ids == ((1, 2, 3),)
    assert read.R[0].ravel().tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 0.9]
    np.testing.assert_array_equal(read.t_mm[0], [-1, np.nan, np.inf])
    assert read.mean_time_s == -1


def test_the_mean_time_is_that_of_images_and_unknown_if_one_is(tmp_path: Path) -> None:
    path = tmp_path / "x_x-test.csv"
    pose = "1 0 0 0 1 0 0 0 1,0 0 500"
    path.write_text(f"1,1,1,1,{pose},2\n1,1,2,1,{pose},2\n1,2,1,1,{pose},5\n")
    assert read_pose_table(path).mean_time_s == 3.5
    path.write_text(f"1,1,1,1,{pose},2\n1,2,1,1,{pose},-1\n")
    assert read_pose_table(path).mean_time_s == -1


tables = st.integers(0, 6).flatmap(
    lambda n: st.lists(
        st.lists(st.sampled_from([0.0, 1.0, 2.0, 3.0, np.inf]), min_size=3, max_size=3), min_size=n, max_size=n
    )
)


@given(tables, st.lists(st.booleans(), min_size=3, max_size=3))
def test_many_thresholds_are_matched_as_one_by_one(errors: list[list[float]], valid: list[bool]) -> None:
    pairs = np.array(errors).reshape(1, len(errors), 3)
    thresholds = np.array([[0.5, 1.0, 2.5, 9.0]])
    together = match_thresholds(pairs, thresholds, np.array(valid))
    for t, threshold in enumerate(thresholds[0]):
        alone = match_poses(pairs[0][..., None], np.array([threshold]), np.array(valid))
        np.testing.assert_array_equal(together[0, t], alone)
        taken = alone[alone >= 0]
        assert len(set(taken.tolist())) == len(taken)
        assert all(valid[g] and pairs[0, e, g] < threshold for e, g in enumerate(alone) if g >= 0)
    found = (together >= 0).sum(axis=2)[0]
    assert found[-1] <= sum(valid)


@given(st.lists(st.tuples(st.floats(0, 1), st.sampled_from([0, 1, 2])), max_size=40), st.integers(0, 10))
def test_average_precision(estimates: list[tuple[float, int]], n_more: int) -> None:
    scores, outcomes = [s for s, _ in estimates], [o for _, o in estimates]
    n_targets = outcomes.count(1) + n_more
    if n_targets == 0:
        return
    order = sorted(range(len(scores)), key=lambda k: scores[k], reverse=True)
    ours = average_precision(np.array(outcomes, dtype=np.int64)[order], n_targets)
    assert ours == pytest.approx(reference.average_precision(scores, outcomes, n_targets), abs=1e-12)


def test_precision_is_the_mean_over_objects_that_have_instances() -> None:
    found = Detections()
    shape = DETECTION_THRESHOLDS.shape
    found.add(1, 2, np.array([0.9, 0.8]), np.full((*shape, 2), 1))
    found.add(2, 1, np.array([0.7]), np.zeros((*shape, 1), np.int64))
    found.add(3, 0, np.array([0.9]), np.full((*shape, 1), IGNORED))
    found.add(4, 3, np.zeros(0), np.zeros((*shape, 0), np.int64))
    assert found.obj_ids == (1, 2, 4)
    assert found.summary(1).map == 1.0
    assert found.summary().map == pytest.approx(1 / 3)
    assert found.summary().n_targets == 6


def test_recalls_of_single_pairs() -> None:
    kinds = np.concatenate([np.full((10, 2), 0.12), [[0.12, np.inf]], [[7.0, np.inf]]])
    recalls = average_recalls(kinds)
    assert recalls.n_targets == 2
    assert recalls.ar_vsd == pytest.approx(0.8)  # above thresholds 0.05 and 0.10
    assert recalls.ar_mssd == pytest.approx(0.4)
    assert recalls.ar_mspd == pytest.approx(0.45)
    assert recalls.ar == pytest.approx((0.8 + 0.4 + 0.45) / 3)
    assert THRESHOLDS.shape == (12, 10)
