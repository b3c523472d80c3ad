"""``verefine-viz evaluate``: what it prints, and what it refuses in one clear line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.batch.frames import make_frames
from tests.commands.evaluating import BadInput, rows
from tests.scenes.bop_folder import OBJ_IDS, box_ply, make
from verefine_viz.run.answers import HEADER as FRAMES_HEADER
from verefine_viz.scenes.results_csv import HEADER, write_results

POSE = "1 0 0 0 1 0 0 0 1,0 0 500"


@pytest.fixture
def bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> BadInput:
    made = make(tmp_path / "boxes")
    results = tmp_path / "perfect_boxes-test.csv"
    write_results(results, rows(made))
    return BadInput(tmp_path, made, capsys, results)


def test_the_table_has_a_row_for_each_file(bad_input: BadInput) -> None:
    other = bad_input.file("other_boxes-test.csv", f"{HEADER}\n7,3,5,1,{POSE},-1\n99,3,5,1,{POSE},-1\n")
    text = bad_input.run(bad_input.results, other)
    lines = {line.split()[0]: line.split() for line in text.splitlines() if line.strip()}
    assert " ".join(lines["method"]) == "method AR VSD MSSD MSPD ADD(-S) r̄ ° t̄ mm missing s/image"
    assert lines["perfect"] == ["perfect", *["100.0"] * 5, "0.0", "0.0", "0", "0.25"]
    assert lines["other"][1] == "0.0"
    assert lines["other"][-2:] == ["2", "-"]


def test_json_holds_every_number(bad_input: BadInput) -> None:
    found = bad_input.json()
    assert (found["dataset"], found["split"], found["targets"]) == ("boxes", "test", "test_targets_bop19.json")
    assert found["seconds"] > 0
    assert len(found["notes"]) == 1
    (score,) = found["results"]
    assert score["method"] == "perfect"
    assert score["file"] == str(bad_input.results)
    assert [score[k] for k in ("AR", "AR_VSD", "AR_MSSD", "AR_MSPD")] == [1.0] * 4
    assert np.shape(score["recalls"]["VSD"]) == (10, 10)
    assert score["recalls"]["MSSD"] == score["recalls"]["MSPD"] == [1.0] * 10
    counts = {"rows": 3, "scored": 3, "surplus": 0, "unasked": 0, "targets": 3, "missing": 0}
    assert score["counts"] == counts
    assert set(score["objects"]) == {"2", "5"}
    assert score["objects"]["2"]["targets"] == 2
    assert score["objects"]["2"]["AR"] == 1.0
    assert score["average_time_per_image_s"] == 0.25
    assert score["add_s_below_10_percent"] == 1.0


def test_json_has_null_where_nothing_is_known(bad_input: BadInput) -> None:
    path = bad_input.file("none_boxes-test.csv", f"7,3,5,1,{POSE.replace('500', 'nan')},-1\n")
    (score,) = bad_input.json(path)["results"]
    assert score["AR"] == 0.0
    assert score["mean_rotation_deg"] is None
    assert score["average_time_per_image_s"] is None
    assert score["own_images"] is None
    assert score["counts"]["missing"] == 2


def test_detection(bad_input: BadInput) -> None:
    (score,) = bad_input.json(bad_input.results, "--task", "detection")["results"]
    assert [score[k] for k in ("mAP", "mAP_MSSD", "mAP_MSPD", "mAP_MSSD_mm")] == [1.0] * 4
    assert "mAP" in bad_input.run(bad_input.results, "--task", "detection", "--per-object")


def test_targets_of_bop24_ask_for_detection(bad_input: BadInput) -> None:
    (bad_input.made.root / "test_targets_bop24.json").write_text(json.dumps([{"scene_id": 7, "im_id": 3}]))
    assert bad_input.json(bad_input.results)["results"][0]["task"] == "localization"
    assert (
        bad_input.json(bad_input.results, "--targets", "test_targets_bop24.json")["results"][0]["task"] == "detection"
    )
    bad_input.refused(bad_input.results, "--targets", "test_targets_bop24.json", "--task", "localization")


def test_ground_truth_in_metres_is_named(bad_input: BadInput) -> None:
    def to_metres(content: dict[str, list[dict[str, list[float]]]]) -> None:
        content["3"][1]["cam_t_m2c"] = [x / 1000 for x in content["3"][1]["cam_t_m2c"]]

    bad_input.made.edit("scene_gt.json", to_metres)
    (note,) = [note for note in bad_input.json()["notes"] if "inside the object by the ground truth of 1 inst" in note]
    assert "image 3, entry 1" in note


def test_a_split_with_another_name_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = make(tmp_path / "tless", split="test_primesense")
    results = tmp_path / "perfect_tless-test.csv"
    write_results(results, rows(made))
    assert BadInput(tmp_path, made, capsys, results).json()["split"] == "test_primesense"


def test_the_sensor_of_the_poses_is_chosen(bad_input: BadInput) -> None:
    made = bad_input.made
    for sensor in ("cam1", "cam2"):
        for file in ("scene_camera", "scene_gt", "scene_gt_info"):
            (made.scene / f"{file}_{sensor}.json").write_bytes((made.scene / f"{file}.json").read_bytes())
        (made.scene / f"depth_{sensor}").symlink_to(made.scene / "depth")
    (made.scene / "scene_camera.json").unlink()
    made.edit("scene_gt_cam2.json", lambda c: c["3"][1].update(cam_t_m2c=[90, 0, 500]))
    first, second = (bad_input.json(bad_input.results, *words) for words in ((), ("--sensor", "cam2")))
    assert (first["results"][0]["AR"], second["results"][0]["AR"] < 1) == (1.0, True)
    assert any("sensor cam1 is read" in note for note in first["notes"])
    assert "cam1, cam2" in bad_input.refused(bad_input.results, "--sensor", "cam3")


def test_without_a_targets_file_all_that_is_visible_is_asked_for(bad_input: BadInput) -> None:
    listed = bad_input.json()
    (bad_input.made.root / "test_targets_bop19.json").unlink()
    found = bad_input.json()
    assert found["targets"] == "all instances that are at least 10 % visible"
    (score,) = found["results"]
    assert score["AR"] == listed["results"][0]["AR"] == 1.0
    assert score["counts"]["targets"] == 3
    bad_input.made.edit("scene_gt_info.json", lambda x: x["3"][1].update(visib_fract=0.05))
    assert bad_input.json()["results"][0]["counts"]["targets"] == 2


def test_without_a_targets_file_images_without_ground_truth_are_not_asked_for(bad_input: BadInput) -> None:
    (bad_input.made.root / "test_targets_bop19.json").unlink()
    bad_input.made.edit("scene_camera.json", lambda x: x.update({"8": x["3"]}))
    assert bad_input.json()["results"][0]["counts"]["targets"] == 3
    bad_input.made.edit("scene_gt.json", lambda x: x.clear())
    bad_input.refused()
    assert "test_targets_bop24.json" in bad_input.refused(bad_input.results, "--task", "detection")


def test_a_mesh_in_metres_is_measured_in_millimetres_and_said(bad_input: BadInput) -> None:
    (bad_input.made.root / "models" / "obj_000005.ply").write_text(box_ply(bad_input.made.problem, unit_m=1.0))
    found = bad_input.json()
    assert [found["results"][0][k] for k in ("AR", "AR_VSD", "AR_MSSD", "AR_MSPD")] == [1.0] * 4
    assert any("141.4 mm" in note for note in found["notes"])


def test_without_scene_gt_info_all_instances_count_as_visible(bad_input: BadInput) -> None:
    (bad_input.made.scene / "scene_gt_info.json").unlink()
    found = bad_input.json()
    assert found["results"][0]["AR"] == 1.0


def test_methods_of_the_same_name_are_called_as_their_folders(bad_input: BadInput) -> None:
    for files, methods in (
        (["a/results.csv", "b/results.csv"], ["a", "b"]),
        (["x/rir/results.csv", "y/rir/results.csv", "y/sir/results.csv"], ["x/rir", "y/rir", "y/sir"]),
        (["rir_boxes-test.csv", "rir_boxes-test_2.csv"], ["rir_boxes-test", "rir_boxes-test_2"]),
        (["a/rir_boxes-test.csv", "b/rir_boxes-test.csv", "sir_boxes-test.csv"], ["a", "b", "sir"]),
        (["a/results.csv", "a/results.csv"], ["a", "a"]),
        (["rir/results.csv", "rir_boxes-test.csv"], ["results", "rir"]),
    ):
        paths = [bad_input.results.parent / "more" / name for name in files]
        for path in paths:
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(bad_input.results, path)
        assert [score["method"] for score in bad_input.json(*paths)["results"]] == methods


def test_how_much_of_the_targets_a_file_covers(bad_input: BadInput) -> None:
    (whole,) = bad_input.json()["results"]
    assert whole["coverage"] == {
        "images": 1, "images_asked": 1, "objects": 2, "objects_asked": 2,
        "not_finite": 0, "not_ranked": 0, "rounded": 0, "not_rigid": 0,
    }  # fmt: skip
    rows_of_one = bad_input.file("dup_lmo-test.csv", f"7,3,5,1,{POSE},-1\n" * 50)
    (one,) = bad_input.json(rows_of_one)["results"]
    assert (one["coverage"]["objects"], one["counts"]["missing"], one["counts"]["surplus"]) == (1, 2, 49)


def test_rows_that_are_no_poses_are_counted_as_the_official_script_counts_them(bad_input: BadInput) -> None:
    mirrored, unknown = "1 0 0 0 1 0 0 0 -1,0 0 500", "nan 0 0 0 1 0 0 0 1,0 0 500"
    lines = [f"7,3,5,1,{mirrored},-1", f"7,3,2,nan,{unknown},-1", f"7,3,2,1,{POSE.replace('500', 'inf')},-1"]
    path = bad_input.file("odd_boxes-test.csv", "\n".join(lines))
    text = bad_input.run(path)
    assert "odd: rows that hold NaN or infinity for a pose, and count as wrong: 2" in text
    assert "odd: rows without a number as score" in text
    assert "odd: rows whose R is no rotation: 1" in text
    (score,) = bad_input.json(path)["results"]
    assert (score["AR"], score["counts"]["missing"]) == (0.0, 0)


def edit(path: str, change: Callable[[Any], None]) -> Callable[[BadInput], None]:
    return lambda bad_input: bad_input.made.edit(path, change)


def remove(path: str) -> Callable[[BadInput], None]:
    return lambda bad_input: (bad_input.made.scene / path).unlink()


def black_and_white(bad_input: BadInput) -> None:
    Image.new("RGB", (80, 60)).save(bad_input.made.scene / "depth" / "000003.png")


BAD_DATA: list[tuple[Callable[[BadInput], None], str]] = [
    (edit("scene_gt.json", lambda x: x.pop("3")), "scene_gt.json has no image 3"),
    (remove("scene_gt.json"), "scene_gt.json"),
    (edit("scene_gt_info.json", lambda x: x["3"].pop()), "scene_gt.json"),
    (edit("scene_camera.json", lambda x: x["3"].update(cam_K=[0] * 8 + [1])), "focal lengths 0, 0"),
    (remove("depth/000003.png"), "000003.png"),
    (black_and_white, "000003.png"),
    (remove("../../models/models_info.json"), "models_info.json"),
    (remove("../../models/obj_000005.ply"), "model 5"),
]


def test_a_data_set_that_cannot_be_used(bad_input: BadInput) -> None:
    for k, (change, words) in enumerate(BAD_DATA):
        spoilt = replace(bad_input, made=make(bad_input.folder / str(k)))
        change(spoilt)
        assert words in spoilt.refused()


def test_a_batch_run_s_table_of_objects_leads_to_its_poses(bad_input: BadInput, tmp_path: Path) -> None:
    (tmp_path / "frames.csv").write_text(FRAMES_HEADER)
    bad_input.refused(tmp_path / "frames.csv")
    poses = tmp_path / "results.csv"
    poses.write_text(HEADER, encoding="utf-8")
    for path in (tmp_path / "frames.csv", tmp_path):
        assert str(poses) in bad_input.refused(path)


def test_targets_that_ask_for_what_is_not_there(bad_input: BadInput) -> None:
    file = bad_input.made.root / "test_targets_bop19.json"
    entries = json.loads(file.read_text())
    file.write_text(json.dumps([*entries, {**entries[0], "obj_id": 77, "inst_count": 2}]))
    found = bad_input.json()
    assert found["results"][0]["counts"]["targets"] == 3
    assert any("5 instances" in note for note in found["notes"])


# Scores over the images that a results file is about, beside the official ones over all targets.


THREE = [
    {"scene_id": 7, "im_id": im_id, "obj_id": obj_id, "inst_count": OBJ_IDS.count(obj_id)}
    for im_id in range(3)
    for obj_id in (2, 5)
]
"""Targets: all instances of images 0, 1 and 2."""


@pytest.fixture
def three(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> BadInput:
    """Three images that are all the same, and a run over the first two that found nothing in the second."""
    made = make_frames(tmp_path / "boxes", 3)
    (made.root / "test_targets_bop19.json").write_text(json.dumps(THREE))
    results = tmp_path / "out" / "results.csv"
    results.parent.mkdir()
    write_results(results, rows(made, im_id=0))
    (results.parent / "run.json").write_text("{}")
    (results.parent / "frames.csv").write_text("scene_id,im_id,status\n7,0,ok\n7,0,ok\n7,1,failed\n")
    return BadInput(tmp_path, made, capsys, results)


def test_the_score_of_a_run_over_some_frames_stands_before_the_official_one(three: BadInput) -> None:
    text = three.run()
    own, official = (line.split() for line in text.splitlines() if line.split()[:1] == ["out"])
    # Three of the six instances that the run was about, and of the nine that the benchmark asks for.
    assert (own[1:3], official[1]) == (["2/3", "50.0"], "33.3")
    (score,) = three.json()["results"]
    assert score["AR"] == 1 / 3
    own_score = score["own_images"]
    assert (own_score["known_from"], own_score["images"], own_score["AR"]) == ("run", 2, 0.5)
    assert (own_score["targets"], own_score["counts"]["missing"]) == (6, 3)
    assert own_score["objects"]["2"]["AR"] == 0.5


def test_objects_that_a_run_was_not_to_solve_do_not_count(three: BadInput) -> None:
    write_results(three.results, [row for row in rows(three.made, im_id=0) if row.obj_id == 5])
    (three.results.parent / "session.toml").write_text("[scene]\nobjects = [5, 9]\n")
    own = next(line.split() for line in three.run().splitlines() if line.split()[:1] == ["out"])
    assert own[1:4] == ["2/3", "1/2", "50.0"]
    n = OBJ_IDS.count(5)  # One object of three instances in an image, of two such images.
    (score,) = three.json()["results"]
    own_score = score["own_images"]
    assert (own_score["only_objects"], own_score["AR"], own_score["targets"]) == ([5], 0.5, 2 * n)
    assert score["AR"] == pytest.approx(n / 9)
    # All images, but not all objects.
    (three.results.parent / "frames.csv").write_text("scene_id,im_id\n7,0\n7,1\n7,2\n")
    own_score = three.json()["results"][0]["own_images"]
    assert (own_score["images"], own_score["AR"], own_score["targets"]) == (3, pytest.approx(1 / 3), 3 * n)


def test_a_run_that_was_to_solve_all_objects_says_nothing_about_objects(three: BadInput) -> None:
    (three.results.parent / "session.toml").write_text("[scene]\nobjects = [2, 5]\n")
    assert three.json()["results"][0]["own_images"]["only_objects"] is None
    # What is not a session says nothing.
    (three.results.parent / "session.toml").write_text("[scene]\nobjects = 5\n")
    assert three.json()["results"][0]["own_images"]["only_objects"] is None


def test_of_a_file_that_nobody_says_more_about_the_official_score_comes_first(three: BadInput) -> None:
    alone = three.folder / "rir_boxes-test.csv"
    shutil.copy(three.results, alone)
    _, own = (line.split() for line in three.run(alone).splitlines() if line.split()[:1] == ["rir"])
    assert own[1:3] == ["1/3", "100.0"]
    (score,) = three.json(alone)["results"]
    own_score = score["own_images"]
    assert (own_score["known_from"], own_score["images"], own_score["AR"]) == ("file", 1, 1.0)
    # What a damaged table says counts for nothing.
    (three.results.parent / "frames.csv").write_text("scene_id,im_id\nseven,0\n")
    assert three.json()["results"][0]["own_images"]["known_from"] == "file"


def test_precision_over_own_images(three: BadInput) -> None:
    (score,) = three.json(three.results, "--task", "detection")["results"]
    assert score["own_images"]["mAP"] > score["mAP"] > 0


def test_a_run_over_all_targets_has_one_score(three: BadInput) -> None:
    table = three.results.parent / "frames.csv"
    table.write_text(table.read_text() + "7,2,failed\n7,8,ok\n")
    assert three.json()["results"][0]["own_images"] is None
