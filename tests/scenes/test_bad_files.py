"""Bad files beside the images: detections, results, models, and folders that are not there or cannot be written."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from tests.scenes.bop_folder import detections, make, refusal
from verefine_viz.core.errors import InputError, SettingsError, VerefineError
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.scenes.results_csv import HEADER, ResultRow, read_results, write_results
from verefine_viz.scenes.source import open_scene


def test_damaged_detections_are_one_clear_line(tmp_path: Path) -> None:
    made, file = make(tmp_path), tmp_path / "det.json"
    for content, words in (
        (b"{}", "holds a JSON dict, expected a list"),
        (gzip.compress(b"[" * 100, mtime=0)[:20], "is a damaged gzip file"),
        (b'[{"scene_id": 7, "im_id": 3}]', "entry 0 has no 'image_id'"),
        (b'[{"scene_id": 7, "image_id": 3.5, "category_id": 2}]', "'image_id' is 3.5, expected an integer"),
        (b'[{"scene_id": 7, "image_id": 3, "category_id": "mug"}]', "'category_id' is 'mug', expected an integer"),
        (b'[{"scene_id": 9, "image_id": 1, "category_id": 2}]', "has no masks for frame 7/3; it has 9/1"),
        (b"[]", "has no masks for frame 7/3; it has none"),
        (b"[" * 100_000, "is not JSON"),
    ):
        file.write_bytes(content)
        assert words in refusal(made, masks=str(file))


def test_damaged_masks_in_detections_are_one_clear_line(tmp_path: Path) -> None:
    made, file = make(tmp_path), tmp_path / "det.json"
    for change, words in (
        ({"segmentation": {"size": [80, 60], "counts": [4800]}}, "made for [h, w] = [80, 60], but the image is 80×60"),
        ({"segmentation": {"size": [60, 80], "counts": [9]}}, "run lengths are damaged, expected a sum of 4800 pixels"),
        ({"score": "high"}, "'score' is 'high', expected a finite number"),
        ({"segmentation": [[1, 2, 3, 4]]}, "no polygons"),
    ):
        entries = detections(made)
        entries[1].update(change)
        file.write_text(json.dumps(entries))
        text = refusal(made, masks=str(file))
        assert "det.json, entry 1" in text
        assert words in text


def test_detections_with_boxes_only_are_refused(tmp_path: Path) -> None:
    made = make(tmp_path)
    (tmp_path / "det.json").write_text(json.dumps(detections(made, "box")))
    assert "has no masks for frame 7/3" in refusal(made, masks=str(tmp_path / "det.json"))


GOOD = "7,3,5,1.0,1 0 0 0 1 0 0 0 1,0 0 600,-1"


R_AND_T = "1 0 0 0 1 0 0 0 1,0 0 600"
BAD_LINES: tuple[tuple[str, str], ...] = (
    ("7,3,5,1.0,1 0 0 0 1 0 0 0 1,nan 0 600,-1", "t holds NaN or infinity"),
    (f"7,3,5,nan,{R_AND_T},-1", "score holds NaN or infinity"),
    ("7,3,5,1.0,1 0 0 0 1 0 0 0 inf,0 0 600,-1", "R holds NaN or infinity"),
    ("7,3,5,1.0,2 0 0 0 1 0 0 0 1,0 0 600,-1", "the pose is not rigid: det(R) = 2.000"),
    ("7,3,5,1.0,1 0 0 0 1 0 0 0 -1,0 0 600,-1", "the pose is not rigid: det(R) = -1.000"),
    ("7,3,5,1.0,1 0 0 0 1 0 0 0,0 0 600,-1", "R holds 8 numbers, expected 9"),
    ("7,3,5,1.0,1 0 0 0 1 0 0 0 1,0 0,-1", "t holds 2 numbers, expected 3"),
    ("7,3,5,1.0,a b c d e f g h i,0 0 600,-1", "R is 'a b c d e f g h i', expected 9 numbers"),
    (f"7,3,5,1.0,{R_AND_T}", "found 6 comma-separated fields, expected 7"),
    (f"7,3,5,1.0,{R_AND_T},-1,", "found 8 comma-separated fields"),
    ("", "found a blank line, expected 7 fields"),
    (HEADER, "scene_id is 'scene_id', expected an integer"),
    (f"7,\0,5,1.0,{R_AND_T},-1", "im_id is '\\x00', expected an integer"),
    (f"7,{'9' * 5000},5,1.0,{R_AND_T},-1", "im_id is '999"),
    (f"7,{'9' * 30},5,1.0,{R_AND_T},-1", "expected an integer below 2⁶³"),
    (f"7,3.0,5,1.0,{R_AND_T},-1", "im_id is '3.0', expected an integer"),
    (f"7,3,5,1.0,{R_AND_T},soon", "time is 'soon', expected seconds"),
    (f"7,3,5,high,{R_AND_T},-1", "score is 'high', expected one number"),
)


def refused_results(path: Path, *lines: str) -> str:
    path.write_text("\n".join(lines))
    with pytest.raises(InputError) as caught:
        read_results(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_bad_line_of_a_results_file_is_named(tmp_path: Path) -> None:
    for bad, words in BAD_LINES:
        said = refused_results(tmp_path / "est_x-test.csv", HEADER, GOOD, bad, GOOD)
        assert "line 3: " in said
        assert words in said


def test_a_header_in_other_letters_or_with_other_commas_is_named(tmp_path: Path) -> None:
    for header in (HEADER.title(), HEADER.replace(",", ";"), HEADER.replace(",", ", ")):
        said = refused_results(tmp_path / "est_x-test.csv", header, GOOD)
        assert f"line 1: the header is '{header}', expected {HEADER}" in said


def test_times_of_one_image_must_agree(tmp_path: Path) -> None:
    said = refused_results(tmp_path / "est_x-test.csv", HEADER, GOOD[:-2] + "1.0", GOOD[:-2] + "1.5")
    assert "line 3: time is 1.5 s, but 1 s in an earlier line of scene 7, image 3" in said


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


def test_a_folder_near_the_data_set(tmp_path: Path) -> None:
    make(tmp_path / "made").root.rename(tmp_path / "yc")
    for named in ("yc/test", "yc/test/000007", "."):
        with pytest.raises(InputError, match=rf"; the data set is {tmp_path}/yc: set scene.dataset to it$"):
            open_scene(SceneSettings(source="bop", dataset=str(tmp_path / named)), HypothesesSettings())


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb", ".stl"])
def test_no_mesh_file_brings_the_reader_down(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bad{suffix}"
    for content in (b"", b"nonsense\n", b"\x00" * 200, b"ply\nformat ascii 1.0\nend_header\n"):
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
