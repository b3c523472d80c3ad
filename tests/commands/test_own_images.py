"""Scores over the images that a results file is about, beside the official ones over all targets."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.batch.frames import make_frames
from tests.commands.evaluating import BadInput, rows
from tests.scenes.bop_folder import OBJ_IDS
from verefine_viz.scenes.results_csv import write_results

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
    own, official = text.index("boxes/test, only the images that each run covered"), text.index("(official score)")
    assert own < official
    assert "boxes/test, test_targets_bop19.json, all 9 targets (official score): average recall [%]" in text
    # Three of the six instances that the run was about, and of the nine that the benchmark asks for.
    assert text[own:official].split("out ")[1].split()[:2] == ["2/3", "50.0"]
    assert text[official:].split("out ")[1].split()[0] == "33.3"
    table = [line for line in text[: text.index("out: has")].splitlines() if not line.startswith("boxes/test")]
    assert max(map(len, table)) <= 80
    (score,) = three.json()["results"]
    assert score["AR"] == 1 / 3
    own_score = score["own_images"]
    assert (own_score["known_from"], own_score["images"], own_score["AR"]) == ("run", 2, 0.5)
    assert (own_score["targets"], own_score["counts"]["missing"]) == (6, 3)
    assert own_score["objects"]["2"]["AR"] == 0.5


def test_the_objects_of_a_run_over_some_frames_are_those_of_its_frames(three: BadInput) -> None:
    text = three.run(three.results, "--per-object")
    assert "out, the 2 of 3 images that the run covered: average recall [%]" in text
    by_object = {line.split()[0]: line.split() for line in text.splitlines() if "obj_00000" in line}
    assert by_object["2"][2] == by_object["5"][2] == "50.0"
    assert by_object["2"][-1:] == ["2/4"]


def test_objects_that_a_run_was_not_to_solve_do_not_count(three: BadInput) -> None:
    write_results(three.results, [row for row in rows(three.made, im_id=0) if row.obj_id == 5])
    (three.results.parent / "session.toml").write_text("[scene]\nobjects = [5, 9]\n")
    text = three.run(three.results, "--per-object")
    own, official = text.index("boxes/test, only the images and objects that each"), text.index("(official score)")
    # One object of three instances in an image, of two such images.
    n = OBJ_IDS.count(5)
    assert text[own:official].split("out ")[1].split()[:3] == ["2/3", "1/2", "50.0"]
    assert "out, object 5 in the 2 of 3 images that the run covered: average recall [%]" in text
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
    assert "boxes/test, only the images that each run covered" in three.run()
    assert three.json()["results"][0]["own_images"]["only_objects"] is None
    # What is not a session says nothing.
    (three.results.parent / "session.toml").write_text("[scene]\nobjects = 5\n")
    assert three.json()["results"][0]["own_images"]["only_objects"] is None


def test_of_a_file_that_nobody_says_more_about_the_official_score_comes_first(three: BadInput) -> None:
    alone = three.folder / "rir_boxes-test.csv"
    shutil.copy(three.results, alone)
    text = three.run(alone)
    official, own = text.index("(official score)"), text.index("boxes/test, only the images that each file names")
    assert official < own
    assert text[own:].split("rir ")[1].split()[:2] == ["1/3", "100.0"]
    (score,) = three.json(alone)["results"]
    own_score = score["own_images"]
    assert (own_score["known_from"], own_score["images"], own_score["AR"]) == ("file", 1, 1.0)
    # What a damaged table says counts for nothing.
    (three.results.parent / "frames.csv").write_text("scene_id,im_id\nseven,0\n")
    assert three.json()["results"][0]["own_images"]["known_from"] == "file"


def test_a_run_over_all_images_says_why_it_is_not_in_the_table_of_files(three: BadInput) -> None:
    alone = three.folder / "rir_boxes-test.csv"
    shutil.copy(three.results, alone)
    (three.results.parent / "frames.csv").write_text("scene_id,im_id\n7,0\n7,1\n7,2\n")
    said = "has no row in the table about the images that each file names, as its run covered all images"
    assert f"out: {said}" in three.run(alone, three.results)
    assert said not in three.run(three.results)
    assert said not in three.run(alone)


def test_precision_over_own_images(three: BadInput) -> None:
    (score,) = three.json(three.results, "--task", "detection")["results"]
    assert score["own_images"]["mAP"] > score["mAP"] > 0
    assert "only the images that each run covered: mean average precision [%]" in three.run(
        three.results, "--task", "detection"
    )


def test_a_run_over_all_targets_has_one_score(three: BadInput) -> None:
    table = three.results.parent / "frames.csv"
    table.write_text(table.read_text() + "7,2,failed\n7,8,ok\n")
    assert "official" not in three.run().split("has estimates for")[0]
    assert three.json()["results"][0]["own_images"] is None
