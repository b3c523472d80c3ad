"""``verefine-viz evaluate``: what it prints, and what it refuses in one clear line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.batch.frames import make_frames
from tests.cli.command_line import CommandLine
from tests.scenes.bop_folder import OBJ_IDS, Made, box_ply, make
from verefine_viz import cli
from verefine_viz.run.answers import HEADER as FRAMES_HEADER
from verefine_viz.scenes.results_csv import HEADER, ResultRow, write_results

POSE = "1 0 0 0 1 0 0 0 1,0 0 500"


@dataclass(frozen=True)
class Evaluation(CommandLine):
    """A data set, a perfect results file, and what the command prints."""

    results: Path

    def run(self, *words: object) -> str:
        """Standard output of a run that ends well."""
        code = cli.main(["evaluate", *map(str, words or [self.results]), "--dataset", str(self.made.root)])
        captured = self.capsys.readouterr()
        assert code == 0, captured.err
        return captured.out

    def json(self, *words: object) -> dict[str, Any]:
        return json.loads(self.run(*(words or [self.results]), "--json"))

    def score(self, *words: object) -> dict[str, Any]:
        """The scores of one file."""
        (score,) = self.json(*words)["results"]
        return score

    def refusal(self, *words: object) -> str:
        return self.refused("evaluate", *(words or [self.results]), "--dataset", self.made.root)


def rows(made: Made, im_id: int = 3) -> list[ResultRow]:
    return [ResultRow(7, im_id, obj_id, 0.5, T, 0.25) for obj_id, T in zip(OBJ_IDS, made.truth, strict=True)]


def perfect(made: Made, capsys: pytest.CaptureFixture[str]) -> Evaluation:
    results = made.root.parent / "perfect_boxes-test.csv"
    write_results(results, rows(made))
    return Evaluation(made.root.parent, made, capsys, results)


@pytest.fixture
def evaluation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Evaluation:
    return perfect(make(tmp_path / "boxes"), capsys)


def test_the_table_has_a_row_for_each_file_and_json_every_number(evaluation: Evaluation) -> None:
    other = evaluation.file("other_boxes-test.csv", f"{HEADER}\n7,3,5,1,{POSE},-1\n99,3,5,1,{POSE},-1\n")
    text = evaluation.run(evaluation.results, other)
    lines = {line.split()[0]: line.split() for line in text.splitlines() if line.strip()}
    assert lines["perfect"] == ["perfect", *["100.0"] * 5, "0.0", "0.0", "0", "0.25"]
    assert (lines["other"][1], lines["other"][-2:]) == ("0.0", ["2", "-"])

    found = evaluation.json()
    assert (found["dataset"], found["split"], found["targets"]) == ("boxes", "test", "test_targets_bop19.json")
    assert found["seconds"] > 0
    assert len(found["notes"]) == 1
    (score,) = found["results"]
    assert (score["method"], score["file"]) == ("perfect", str(evaluation.results))
    assert [score[k] for k in ("AR", "AR_VSD", "AR_MSSD", "AR_MSPD", "add_s_below_10_percent")] == [1.0] * 5
    assert np.shape(score["recalls"]["VSD"]) == (10, 10)
    assert score["recalls"]["MSSD"] == score["recalls"]["MSPD"] == [1.0] * 10
    assert score["counts"] == {"rows": 3, "scored": 3, "surplus": 0, "unasked": 0, "targets": 3, "missing": 0}
    assert {k: (of["targets"], of["AR"]) for k, of in score["objects"].items()} == {"2": (2, 1.0), "5": (1, 1.0)}
    assert score["average_time_per_image_s"] == 0.25
    assert score["coverage"] == {
        "images": 1, "images_asked": 1, "objects": 2, "objects_asked": 2,
        "not_finite": 0, "not_ranked": 0, "rounded": 0, "not_rigid": 0,
    }  # fmt: skip


def test_rows_that_are_no_poses_or_too_many_are_counted_and_what_is_unknown_is_null(evaluation: Evaluation) -> None:
    surplus = evaluation.score(evaluation.file("dup_lmo-test.csv", f"7,3,5,1,{POSE},-1\n" * 50))
    counts = surplus["counts"]
    assert (surplus["coverage"]["objects"], counts["missing"], counts["surplus"]) == (1, 2, 49)

    lines = [
        "7,3,5,1,1 0 0 0 1 0 0 0 -1,0 0 500,-1",  # mirrored
        "7,3,2,nan,nan 0 0 0 1 0 0 0 1,0 0 500,-1",
        f"7,3,2,1,{POSE.replace('500', 'inf')},-1",
    ]
    odd = evaluation.score(path := evaluation.file("odd_boxes-test.csv", "\n".join(lines)))
    assert (odd["AR"], odd["counts"]["missing"]) == (0.0, 0)
    assert [odd["coverage"][k] for k in ("not_finite", "not_ranked", "not_rigid")] == [2, 1, 1]
    assert sum(line.startswith("odd: rows ") for line in evaluation.run(path).splitlines()) == 3

    unknown = evaluation.score(evaluation.file("none_boxes-test.csv", f"7,3,5,1,{POSE.replace('500', 'nan')},-1\n"))
    assert (unknown["AR"], unknown["counts"]["missing"]) == (0.0, 2)
    assert [unknown[k] for k in ("mean_rotation_deg", "average_time_per_image_s", "own_images")] == [None] * 3


def test_detection_is_asked_for_by_a_task_or_by_its_targets(evaluation: Evaluation) -> None:
    score = evaluation.score(evaluation.results, "--task", "detection")
    assert [score[k] for k in ("mAP", "mAP_MSSD", "mAP_MSPD", "mAP_MSSD_mm")] == [1.0] * 4
    assert "mAP" in evaluation.run(evaluation.results, "--task", "detection", "--per-object")
    of_2024 = "test_targets_bop24.json"
    (evaluation.made.root / of_2024).write_text(json.dumps([{"scene_id": 7, "im_id": 3}]))
    assert evaluation.score()["task"] == "localization"
    assert evaluation.score(evaluation.results, "--targets", of_2024)["task"] == "detection"
    evaluation.refusal(evaluation.results, "--targets", of_2024, "--task", "localization")


def in_metres(made: Made) -> None:
    made.edit("scene_gt.json", lambda c: c["3"][1].update(cam_t_m2c=[x / 1000 for x in c["3"][1]["cam_t_m2c"]]))


def one_more_target(made: Made) -> None:
    entry = {"scene_id": 7, "im_id": 3, "obj_id": 77, "inst_count": 2}
    made.edit("../../test_targets_bop19.json", lambda content: content.append(entry))


def mesh_in_metres(made: Made) -> None:
    (made.root / "models" / "obj_000005.ply").write_text(box_ply(made.problem, unit_m=1.0))


@pytest.mark.parametrize(
    ("change", "noted", "ar"),
    [(in_metres, "image 3, entry 1", None), (mesh_in_metres, "141.4 mm", 1.0), (one_more_target, "5 instances", 1.0)],
)
def test_what_is_odd_in_the_data_is_noted(
    evaluation: Evaluation, change: Callable[[Made], None], noted: str, ar: float | None
) -> None:
    change(evaluation.made)
    found = evaluation.json()
    assert any(noted in note for note in found["notes"])
    assert found["results"][0]["counts"]["targets"] == 3
    assert ar in (None, found["results"][0]["AR"])


def test_a_split_with_another_name_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = make(tmp_path / "boxes", split="test_primesense")
    assert perfect(made, capsys).json()["split"] == "test_primesense"


def test_the_sensor_of_the_poses_is_chosen(evaluation: Evaluation) -> None:
    made = evaluation.made
    for sensor in ("cam1", "cam2"):
        for file in ("scene_camera", "scene_gt", "scene_gt_info"):
            (made.scene / f"{file}_{sensor}.json").write_bytes((made.scene / f"{file}.json").read_bytes())
        (made.scene / f"depth_{sensor}").symlink_to(made.scene / "depth")
    (made.scene / "scene_camera.json").unlink()
    made.edit("scene_gt_cam2.json", lambda c: c["3"][1].update(cam_t_m2c=[90, 0, 500]))
    first, second = (evaluation.json(evaluation.results, *words) for words in ((), ("--sensor", "cam2")))
    assert (first["results"][0]["AR"], second["results"][0]["AR"] < 1) == (1.0, True)
    assert any("cam1" in note for note in first["notes"])
    assert "cam1, cam2" in evaluation.refusal(evaluation.results, "--sensor", "cam3")


def test_without_a_targets_file_all_that_is_visible_and_known_is_asked_for(evaluation: Evaluation) -> None:
    made = evaluation.made
    (made.root / "test_targets_bop19.json").unlink()
    made.edit("scene_camera.json", lambda x: x.update({"8": x["3"]}))  # An image without ground truth.
    assert (evaluation.score()["AR"], evaluation.score()["counts"]["targets"]) == (1.0, 3)
    made.edit("scene_gt_info.json", lambda x: x["3"][1].update(visib_fract=0.05))
    assert evaluation.score()["counts"]["targets"] == 2
    (made.scene / "scene_gt_info.json").unlink()
    assert (evaluation.score()["AR"], evaluation.score()["counts"]["targets"]) == (1.0, 3)
    made.edit("scene_gt.json", lambda x: x.clear())
    evaluation.refusal()
    assert "test_targets_bop24.json" in evaluation.refusal(evaluation.results, "--task", "detection")


def test_methods_of_the_same_name_are_called_as_their_folders(evaluation: Evaluation) -> None:
    for files, methods in (
        (["a/results.csv", "b/results.csv"], ["a", "b"]),
        (["x/rir/results.csv", "y/rir/results.csv", "y/sir/results.csv"], ["x/rir", "y/rir", "y/sir"]),
        (["rir_boxes-test.csv", "rir_boxes-test_2.csv"], ["rir_boxes-test", "rir_boxes-test_2"]),
        (["a/rir_boxes-test.csv", "b/rir_boxes-test.csv", "sir_boxes-test.csv"], ["a", "b", "sir"]),
        (["a/results.csv", "a/results.csv"], ["a", "a"]),
        (["rir/results.csv", "rir_boxes-test.csv"], ["results", "rir"]),
    ):
        paths = [evaluation.file(f"more/{name}", evaluation.results.read_bytes()) for name in files]
        assert [score["method"] for score in evaluation.json(*paths)["results"]] == methods


def edit(path: str, change: Callable[[Any], None]) -> Callable[[Made], None]:
    return lambda made: made.edit(path, change)


def remove(path: str) -> Callable[[Made], None]:
    return lambda made: (made.scene / path).unlink()


def black_and_white(made: Made) -> None:
    Image.new("RGB", (80, 60)).save(made.scene / "depth" / "000003.png")


BAD_DATA: tuple[tuple[Callable[[Made], None], str], ...] = (
    (edit("scene_gt.json", lambda x: x.pop("3")), "image 3"),
    (remove("scene_gt.json"), "scene_gt.json"),
    (edit("scene_gt_info.json", lambda x: x["3"].pop()), "scene_gt.json"),
    (edit("scene_camera.json", lambda x: x["3"].update(cam_K=[0] * 8 + [1])), "focal lengths 0, 0"),
    (remove("depth/000003.png"), "000003.png"),
    (black_and_white, "000003.png"),
    (remove("../../models/models_info.json"), "models_info.json"),
    (remove("../../models/obj_000005.ply"), "model 5"),
)


def test_a_data_set_that_cannot_be_used(evaluation: Evaluation) -> None:
    for k, (change, named) in enumerate(BAD_DATA):
        spoilt = replace(evaluation, made=make(evaluation.folder / str(k)))
        change(spoilt.made)
        assert named in spoilt.refusal()


def test_a_batch_run_s_table_of_objects_leads_to_its_poses(evaluation: Evaluation) -> None:
    table = evaluation.file("out/frames.csv", FRAMES_HEADER)
    evaluation.refusal(table)
    poses = evaluation.file("out/results.csv", HEADER)
    for path in (table, table.parent):
        assert str(poses) in evaluation.refusal(path)


# Scores over the images that a results file is about, beside the official ones over all targets.


THREE = [
    {"scene_id": 7, "im_id": im_id, "obj_id": obj_id, "inst_count": OBJ_IDS.count(obj_id)}
    for im_id in range(3)
    for obj_id in (2, 5)
]
"""Targets: all instances of images 0, 1 and 2."""


@pytest.fixture
def three(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Evaluation:
    """Three images that are all the same, and a run over the first two that found nothing in the second."""
    made = make_frames(tmp_path / "boxes", 3)
    (made.root / "test_targets_bop19.json").write_text(json.dumps(THREE))
    found = Evaluation(tmp_path, made, capsys, tmp_path / "out" / "results.csv")
    found.file("out/run.json", "{}")
    found.file("out/frames.csv", "scene_id,im_id,status\n7,0,ok\n7,0,ok\n7,1,failed\n")
    write_results(found.results, rows(made, im_id=0))
    return found


def lines_of(three: Evaluation, method: str, *words: object) -> list[list[str]]:
    return [line.split() for line in three.run(*words).splitlines() if line.split()[:1] == [method]]


def test_the_score_of_a_run_over_some_frames_stands_before_the_official_one(three: Evaluation) -> None:
    own, official = lines_of(three, "out")
    # Three of the six instances that the run was about, and of the nine that the benchmark asks for.
    assert (own[1:3], official[1]) == (["2/3", "50.0"], "33.3")
    score = three.score()
    assert score["AR"] == 1 / 3
    own_score = score["own_images"]
    assert (own_score["known_from"], own_score["images"], own_score["AR"]) == ("run", 2, 0.5)
    assert (own_score["targets"], own_score["counts"]["missing"]) == (6, 3)
    assert own_score["objects"]["2"]["AR"] == 0.5
    precision = three.score(three.results, "--task", "detection")
    assert precision["own_images"]["mAP"] > precision["mAP"] > 0
    three.file("out/frames.csv", "scene_id,im_id,status\n7,0,ok\n7,1,failed\n7,2,failed\n7,8,ok\n")
    assert three.score()["own_images"] is None, "it was over all targets"


def test_objects_that_a_run_was_not_to_solve_do_not_count(three: Evaluation) -> None:
    # All objects, or what is no session, say nothing about objects.
    for session in ("[scene]\nobjects = [2, 5]\n", "[scene]\nobjects = 5\n"):
        three.file("out/session.toml", session)
        assert three.score()["own_images"]["only_objects"] is None
    write_results(three.results, [row for row in rows(three.made, im_id=0) if row.obj_id == 5])
    three.file("out/session.toml", "[scene]\nobjects = [5, 9]\n")
    assert lines_of(three, "out")[0][1:4] == ["2/3", "1/2", "50.0"]
    n = OBJ_IDS.count(5)  # One object of three instances in an image, of two such images.
    score = three.score()
    own_score = score["own_images"]
    assert (own_score["only_objects"], own_score["AR"], own_score["targets"]) == ([5], 0.5, 2 * n)
    assert score["AR"] == pytest.approx(n / 9)
    # All images, but not all objects.
    three.file("out/frames.csv", "scene_id,im_id\n7,0\n7,1\n7,2\n")
    own_score = three.score()["own_images"]
    assert (own_score["images"], own_score["AR"], own_score["targets"]) == (3, pytest.approx(1 / 3), 3 * n)


def test_of_a_file_that_nobody_says_more_about_the_official_score_comes_first(three: Evaluation) -> None:
    alone = three.folder / "rir_boxes-test.csv"
    shutil.copy(three.results, alone)
    _, own = lines_of(three, "rir", alone)
    assert own[1:3] == ["1/3", "100.0"]
    own_score = three.score(alone)["own_images"]
    assert (own_score["known_from"], own_score["images"], own_score["AR"]) == ("file", 1, 1.0)
    # What a damaged table says counts for nothing.
    three.file("out/frames.csv", "scene_id,im_id\nseven,0\n")
    assert three.score()["own_images"]["known_from"] == "file"
