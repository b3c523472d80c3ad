"""Bad files beside the images: detections, results, models, and folders that are not there or cannot be written."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.scenes.bop_folder import Made, detections, make, refusal
from tests.scenes.write_bop import write_bop
from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.scenes.results_csv import HEADER, ResultRow, read_results, write_results
from verefine_viz.scenes.source import open_scene

Spoil = Callable[[Made], Any]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"{}", "holds a JSON dict, expected a list"),
        (b"nonsense", "is not JSON"),
        (gzip.compress(b"[" * 100, mtime=0)[:20], "is a damaged gzip file"),
        (b'[{"scene_id": 7, "im_id": 3}]', "entry 0 has no 'image_id'"),
        (b'[{"scene_id": 7, "image_id": 3.5, "category_id": 2}]', "'image_id' is 3.5, expected an integer"),
        (b'[{"scene_id": 7, "image_id": 3, "category_id": "mug"}]', "'category_id' is 'mug', expected an integer"),
        (b'[{"scene_id": 9, "image_id": 1, "category_id": 2}]', "has no masks for frame 7/3; it has 9/1"),
        (b"[]", "has no masks for frame 7/3; it has none"),
        (b"[" * 100_000, "is not JSON"),
    ],
)
def test_damaged_detections_are_one_clear_line(tmp_path: Path, content: bytes, words: str) -> None:
    made = make(tmp_path)
    (tmp_path / "det.json").write_bytes(content)
    assert words in refusal(made, masks=str(tmp_path / "det.json"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda e: e["segmentation"].update(size=[80, 60]), "made for [h, w] = [80, 60], but the image is 80×60"),
        (lambda e: e["segmentation"]["counts"].pop(), "run lengths are damaged, expected a sum of 4800 pixels"),
        (lambda e: e.update(score="high"), "'score' is 'high', expected a finite number"),
        (lambda e: e.update(segmentation=[[1, 2, 3, 4]]), "no polygons"),
    ],
)
def test_damaged_masks_in_detections_are_one_clear_line(tmp_path: Path, change: Spoil, words: str) -> None:
    made = make(tmp_path)
    entries = detections(made)
    change(entries[1])  # pyright: ignore[reportArgumentType]
    (tmp_path / "det.json").write_text(json.dumps(entries))
    text = refusal(made, masks=str(tmp_path / "det.json"))
    assert "det.json, entry 1" in text
    assert words in text


def test_detections_with_boxes_only_are_refused(tmp_path: Path) -> None:
    made = make(tmp_path)
    (tmp_path / "det.json").write_text(json.dumps(detections(made, "box")))
    assert "has no masks for frame 7/3" in refusal(made, masks=str(tmp_path / "det.json"))


GOOD = "7,3,5,1.0,1 0 0 0 1 0 0 0 1,0 0 600,-1"


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ("7,3,5,1.0,1 0 0 0 1 0 0 0 1,nan 0 600,-1", "line 3: t holds NaN or infinity"),
        ("7,3,5,nan,1 0 0 0 1 0 0 0 1,0 0 600,-1", "line 3: score holds NaN or infinity"),
        ("7,3,5,1.0,1 0 0 0 1 0 0 0 inf,0 0 600,-1", "line 3: R holds NaN or infinity"),
        ("7,3,5,1.0,2 0 0 0 1 0 0 0 1,0 0 600,-1", "line 3: the pose is not rigid: det(R) = 2.000"),
        ("7,3,5,1.0,1 0 0 0 1 0 0 0 -1,0 0 600,-1", "line 3: the pose is not rigid: det(R) = -1.000"),
        ("7,3,5,1.0,1 0 0 0 1 0 0 0,0 0 600,-1", "line 3: R holds 8 numbers, expected 9"),
        ("7,3,5,1.0,1 0 0 0 1 0 0 0 1,0 0,-1", "line 3: t holds 2 numbers, expected 3"),
        (
            "7,3,5,1.0,a b c d e f g h i,0 0 600,-1",
            "line 3: R is 'a b c d e f g h i', expected 9 numbers",
        ),
        ("7,3,5,1.0,1 0 0 0 1 0 0 0 1,0 0 600", "line 3: found 6 comma-separated fields, expected 7"),
        ("7,3,5,1.0,1 0 0 0 1 0 0 0 1,0 0 600,-1,", "line 3: found 8 comma-separated fields"),
        ("", "line 3: found a blank line, expected 7 fields"),
        (f"7,{'9' * 5000},5,1.0,1 0 0 0 1 0 0 0 1,0 0 600,-1", "line 3: im_id is '999"),
        (f"7,{'9' * 30},5,1.0,1 0 0 0 1 0 0 0 1,0 0 600,-1", "expected an integer below 2⁶³"),
        ("7,3.0,5,1.0,1 0 0 0 1 0 0 0 1,0 0 600,-1", "line 3: im_id is '3.0', expected an integer"),
        ("7,3,5,1.0,1 0 0 0 1 0 0 0 1,0 0 600,soon", "line 3: time is 'soon', expected seconds"),
        ("7,3,5,high,1 0 0 0 1 0 0 0 1,0 0 600,-1", "line 3: score is 'high', expected one number"),
    ],
)
def test_a_bad_line_of_a_results_file_is_named(tmp_path: Path, bad: str, words: str) -> None:
    path = tmp_path / "est_x-test.csv"
    path.write_text("\n".join([HEADER, GOOD, bad, GOOD]))
    with pytest.raises(InputError) as caught:
        read_results(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_times_of_one_image_must_agree(tmp_path: Path) -> None:
    path = tmp_path / "est_x-test.csv"
    path.write_text("\n".join([HEADER, GOOD[:-2] + "1.0", GOOD[:-2] + "1.5"]))
    with pytest.raises(InputError, match=r"line 3: time is 1\.5 s, but 1 s in an earlier line of scene 7, image 3"):
        read_results(path)


def test_results_that_are_not_there_or_no_text(tmp_path: Path) -> None:
    made = make(tmp_path)
    missing = HypothesesSettings(source="results", files=(str(tmp_path / "no.csv"),))
    assert "no.csv does not exist" in refusal(made, missing)
    assert "is a folder, expected a file" in refusal(made, HypothesesSettings(source="results", files=(str(tmp_path),)))
    assert "hypotheses.files is empty" in refusal(made, HypothesesSettings(source="results"))
    (tmp_path / "bin.csv").write_bytes(bytes(range(128, 256)))
    assert "is no text file" in refusal(made, HypothesesSettings(source="results", files=(str(tmp_path / "bin.csv"),)))


def test_results_that_cannot_be_written(tmp_path: Path) -> None:
    row = ResultRow(1, 2, 3, 0.5, np.eye(4))
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "a.csv", tmp_path / "folder.csv"):
        with pytest.raises(InputError, match="cannot write "):
            write_results(path, [row])


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written: Not a directory"):
        write_bop(tmp_path / "file" / "made", [box_problem()])


def test_a_data_set_that_is_not_there() -> None:
    for dataset, words in (("", "scene.dataset is empty"), ("/nowhere/ycbv", "/nowhere/ycbv does not exist")):
        with pytest.raises(VerefineError, match=words):
            open_scene(SceneSettings(source="bop", dataset=dataset), HypothesesSettings())


def test_a_folder_that_is_no_data_set(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown split 'test'; available: none"):
        open_scene(SceneSettings(source="bop", dataset=str(tmp_path)), HypothesesSettings())
    (tmp_path / "test" / "000001").mkdir(parents=True)
    with pytest.raises(InputError, match="has no object models"):
        open_scene(SceneSettings(source="bop", dataset=str(tmp_path)), HypothesesSettings())


def test_a_folder_of_data_sets(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name / "test" / "000001").mkdir(parents=True)
    expected = rf"; data sets that have it: {tmp_path}/a, {tmp_path}/b; set scene.dataset to one of them$"
    with pytest.raises(InputError, match=expected):
        open_scene(SceneSettings(source="bop", dataset=str(tmp_path)), HypothesesSettings())


@pytest.mark.parametrize("named", ["yc/test", "yc/test/000007", "."])
def test_a_folder_near_the_data_set(tmp_path: Path, named: str) -> None:
    make(tmp_path / "made").root.rename(tmp_path / "yc")
    with pytest.raises(InputError, match=rf"; the data set is {tmp_path}/yc: set scene.dataset to it$"):
        open_scene(SceneSettings(source="bop", dataset=str(tmp_path / named)), HypothesesSettings())


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb", ".stl"])
@pytest.mark.parametrize("content", [b"", b"nonsense\n", b"\x00" * 200, b"ply\nformat ascii 1.0\nend_header\n"])
def test_no_mesh_file_brings_the_reader_down(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_mesh(path, 1e-3)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_meshes_of_unknown_formats_and_missing_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no mesh file; supported: ply, obj, glb, gltf, stl"):
        read_mesh(tmp_path / "a.step", 1e-3)
    with pytest.raises(InputError, match="is missing"):
        read_mesh(tmp_path / "a.ply", 1e-3)


def test_settings_errors_are_settings_errors(tmp_path: Path) -> None:
    # The command line tells wrong settings and wrong files apart by these.
    made = make(tmp_path)
    with pytest.raises(SettingsError):
        made.open(objects=(9,))
    with pytest.raises(SettingsError):
        made.open(frames=("x",))
