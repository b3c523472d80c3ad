"""Mistakes that people make: one line that names the place; trouble with one object leaves the others."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes.bop_folder import Made, box_ply, cut, detections, image, make, refusal
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.evaluation.results_scores import evaluate_files
from verefine_viz.scenes.results_csv import HEADER, read_poses, read_results

Spoil = Callable[[Made], Any]
MASK = "mask_visib/000003_000001.png"
POSE = "1 0 0 0 1 0 0 0 1,0 0 600"


def edited(file: str, change: Callable[[Any], Any]) -> Spoil:
    return lambda made: made.edit(file, change)


def camera(**fields: Any) -> Spoil:
    """Other fields of the frame's camera."""
    return edited("scene_camera.json", lambda c: c["3"].update(fields))


def truth(**fields: Any) -> Spoil:
    """Other fields of instance 1 in the ground truth."""
    return edited("scene_gt.json", lambda c: c["3"][1].update(fields))


def about_model(**fields: Any) -> Spoil:
    """Other fields of object 5 in models_info.json."""
    return edited("../../models/models_info.json", lambda c: c["5"].update(fields))


def written(file: str, text: str) -> Spoil:
    return lambda made: (made.scene / file).write_text(text)


FRAMES: tuple[tuple[Spoil, str], ...] = (
    (lambda m: cut(m.scene / "depth/000003.png"), "depth/000003.png: it is cut off, fetch it again"),
    (lambda m: (m.scene / "depth/000003.png").unlink(), "depth/000003.png is missing; a depth image is needed"),
    (lambda m: image(m, "depth/000003.png", np.zeros((60, 80), np.uint16)), "is 0 everywhere: the frame has no depth"),
    (lambda m: image(m, "depth/000003.png", np.ones((60, 80, 3), np.uint8)), "is a RGB image, expected one channel"),
    (lambda m: image(m, "rgb/000003.png", np.ones((48, 64, 3), np.uint8)), "is 64×48 pixels, but the depth image is"),
    (written("scene_camera.json", '{"3": {"cam_K": [1, 2,,]}}'), "scene_camera.json: not JSON: invalid character in "),
    (written("scene_camera.json", "[]"), "scene_camera.json: Expected `object`, got `array`"),
    (edited("scene_camera.json", lambda c: c["3"].pop("cam_K")), "scene_camera.json, image 3 has no 'cam_K'"),
    (edited("scene_camera.json", lambda c: c.update({"3": {"cam_model": {}}})), "'cam_model' (fisheye); only pinhole"),
    (camera(cam_K=[1] * 8), "image 3: Expected 9 numbers, got 8 (at $.cam_K)"),
    (camera(cam_K=[90, 0, 0, 0, 90, 0, 40, 30, 1]), "it looks written column by column: write it row by row"),
    (camera(cam_K=[1e99, 0, 40, 0, 90, 30, 0, 0, 1]), "cam_K has focal lengths 1e+99, 90; expected positive pixels"),
    (camera(depth_scale=0), "image 3: Expected `float` >= 1e-06 (at $.depth_scale)"),
    (lambda m: shutil.rmtree(m.scene / "mask_visib"), "mask_visib is missing; set scene.masks to 'mask'"),
)  # fmt: skip
OBJECTS: tuple[tuple[Spoil, str], ...] = (
    (lambda m: image(m, MASK, np.full((64, 48), 255, np.uint8)), "is 48×64 pixels, expected 80×60 as the depth image"),
    (lambda m: cut(m.root / "models/obj_000005.ply", 0.9), "of 12 faces; fetch it again"),
    (
        lambda m: (m.root / "models/obj_000005.ply").write_text(box_ply(m.problem).replace("3 0 1 3", "3 0 1 99", 1)),
        "object 5 is left out: ",
    ),
    (about_model(diameter=-3), "object 5: Expected `float` >= 0.001 (at $.diameter)"),
    (
        about_model(symmetries_continuous=[{"axis": [0, 0, 1], "offset": [0, 0, 1e30]}]),
        "symmetries_continuous[0]: 'offset' is 1e+27 m away, expected at most 100 m",
    ),
    (about_model(symmetries_continuous=[{}]), "missing required field `axis` (at $.symmetries_continuous[0])"),
)
NOTED: tuple[tuple[Spoil, str], ...] = (
    (truth(cam_R_m2c=[1, 0, 0, 0, 1, 0, 0, 0, -1]), "the pose is not rigid: det(R) = -1.000"),
    (truth(cam_t_m2c=[0, 0, 1e30]), "'cam_t_m2c' is 1e+27 m away, expected at most 100 m; is it in millimetres?"),
    (edited("scene_gt.json", lambda c: c["3"][1].pop("cam_R_m2c")), "entry 1 has no 'cam_R_m2c'"),
    (truth(cam_t_m2c=[float("nan"), 0, 1]), "image 3, entry 1: 'cam_t_m2c': Expected finite numbers"),
    (truth(cam_R_m2c=[1] * 8), "image 3, entry 1: 'cam_R_m2c': Expected 9 numbers, got 8"),
)
FRAME_NOTED: tuple[tuple[Spoil, str], ...] = (
    (camera(cam_R_w2c=[2] * 9), "'cam_R_w2c' is not rigid"),
    (camera(cam_R_w2c=[float("nan")] * 9), "'cam_R_w2c': Expected finite numbers; the camera's pose is left out"),
    (camera(cam_R_w2c=np.eye(3).tolist(), cam_t_w2c=[1]), "'cam_t_w2c': Expected 3 numbers, got 1; the camera's pos"),
    (lambda m: cut(m.scene / "rgb/000003.png"), "it is cut off, fetch it again; the frame is drawn without colour"),
)
"""What a frame does without."""
SOURCE_NOTED: tuple[tuple[Spoil, str], ...] = (
    (edited("scene_camera.json", lambda c: c.update(left=1)), "'left' is no image, expected its number"),
    (edited("scene_gt.json", lambda c: c.update(left=1)), "'left' is no image, expected its number"),
    (edited("scene_gt.json", lambda c: c["3"][1].pop("obj_id")), "image 3, entry 1: 'obj_id' is None, expected the nu"),
    (truth(cam_t_m2c=[float("nan"), 0, 1]), "1 entry of the ground truth of 3/test cannot be used and is left out: "),
    (written("../../models/obj_names.json", '{"a": "b", "5": "mug"}'), "'a': 'b' does not name an object id"),
    (edited("../../models/models_info.json", lambda c: c.update(mug={})), "'mug' is no object, expected its number"),
    (edited("scene_gt_info.json", lambda c: c["3"][1].update(visib_fract="all")), ""),
    (lambda m: shutil.copytree(m.scene, m.scene.with_name("000008")) / "scene_camera.json", ""),
    (
        lambda m: (shutil.copytree(m.scene, m.scene.with_name("000008")) / "scene_camera.json").write_text("{"),
        "1 scene of 8/test cannot be used and is left out: ",
    ),
)
"""What a data set does without: said once, when it is opened."""
TARGET = '{"scene_id": 7, "im_id": 3, "obj_id": 5, "inst_count": 1}'
TARGETS_NOTED: tuple[tuple[str, str], ...] = (
    ('[{"scene_id": 7}]', "1 entry of test_targets_bop19.json cannot be used and is left out: entry 0: Object missing"),
    (f'[{TARGET}, {{"scene_id": 7, "im_id": 3}}]', "entry 1 has no 'obj_id' or no 'inst_count', as the first one has"),
    ("[", "bop19.json: not JSON: "),
)


def test_trouble_with_a_frame_is_one_line(tmp_path: Path) -> None:
    for k, (spoil, words) in enumerate(FRAMES):
        made = make(tmp_path / str(k))
        spoil(made)
        assert words in refusal(made)


@pytest.mark.parametrize(("cases", "left"), [(OBJECTS, [0, 2]), (NOTED, [0, 1, 2])], ids=["left out", "noted"])
def test_trouble_with_an_object_is_a_note_and_the_others_go_on(
    tmp_path: Path, cases: tuple[tuple[Spoil, str], ...], left: list[int]
) -> None:
    for k, (spoil, words) in enumerate(cases):
        made = make(tmp_path / str(k))
        spoil(made)
        problem = made.read()
        assert [i.instance_id for i in problem.instances] == left, words
        assert any(words in note for note in problem.notes), (words, problem.notes)
        if cases is NOTED:
            assert [i.T_cam_obj_gt is None for i in problem.instances] == [False, True, False]


def test_what_a_frame_or_a_data_set_does_without_is_noted_once(tmp_path: Path) -> None:
    for k, (spoil, words) in enumerate(FRAME_NOTED):
        made = make(tmp_path / f"frame/{k}")
        spoil(made)
        problem = made.read()
        assert len(problem.instances) == 3, words
        assert sum(words in note for note in problem.notes) == 1, (words, problem.notes)
    for k, (spoil, words) in enumerate(SOURCE_NOTED):
        made = make(tmp_path / f"source/{k}", targets=False)
        spoil(made)
        source = made.open()
        assert sum(words in note for note in source.notes) == bool(words), (words, source.notes)
        assert {i.obj_id for i in source.problem("7/3").instances} >= {2}, words
        assert made.open(objects=(2,)).frames == source.frames, words
    for k, (text, words) in enumerate(TARGETS_NOTED):
        made = make(tmp_path / f"targets/{k}")
        written("../../test_targets_bop19.json", text)(made)
        source = made.open()
        assert source.frames == ("7/3",), words
        assert sum(words in note for note in source.notes) == 1, (words, source.notes)


def test_one_bad_frame_does_not_close_a_data_set_in_which_objects_are_chosen(tmp_path: Path) -> None:
    made = make(tmp_path, targets=False)
    for file in ("scene_camera.json", "scene_gt.json"):
        made.edit(file, lambda c: c.update({"4": c["3"]}))
    made.edit("scene_gt.json", lambda c: c.update({"3": "none"}))
    source = made.open(objects=(5,))
    assert source.frames == ("7/4",)
    assert sum("image 3: Expected `array`, got `str`" in note for note in source.notes) == 1


def test_a_principal_point_outside_of_the_image_is_noted(made: Made) -> None:
    for cx, cy, is_noted in ((-1, 30, True), (80, 30, True), (40, 60, True), (0, 0, False), (79, 59, False)):
        camera(cam_K=[90, 0, cx, 0, 90, cy, 0, 0, 1])(made)
        said = f"cx, cy of cam_K are {cx}, {cy} px, outside of the image of 80×60 px"
        assert any(said in note for note in made.read().notes) == is_noted


def test_trouble_with_detections(tmp_path: Path) -> None:
    made, file = make(tmp_path), tmp_path / "det.json"
    for change, words in (
        ({"segmentation": {"size": [80, 60], "counts": [4800]}}, "made for [h, w] = [80, 60], but the image is 80×60"),
        ({"segmentation": {"size": [60, 80], "counts": [9]}}, "run lengths are damaged, expected a sum of 4800 pixels"),
        ({"segmentation": [[1, 2, 3, 4]]}, "entry 1: 'segmentation': Expected `object`, got `array`; polygons are not"),
        ({"score": "high"}, "entry 1: Expected `float`, got `str` (at $.score)"),
        ({"category_id": "mug"}, "entry 1: Expected `int`, got `str` (at $.category_id)"),
    ):
        entries = detections(made)
        entries[1].update(change)
        file.write_text(json.dumps(entries))
        source = made.open(masks=str(file))
        problem = source.problem(made.frame)
        assert sum(words in note for note in (*source.notes, *problem.notes)) == 1, (source.notes, problem.notes)
        assert [i.obj_id for i in problem.instances] == [2, 2]
        file.write_text(json.dumps(entries[1:2]))
        assert words.removeprefix("entry 1: ") in refusal(made, masks=str(file))
    file.write_text(json.dumps(detections(made)))
    made.edit("scene_gt.json", lambda c: c.update({"3": "none"}))
    problem = made.read(masks=str(file))  # Which does without ground truth.
    assert len(problem.instances) == 3
    assert any("the frame has no ground truth: " in note for note in problem.notes)
    file.write_text(json.dumps(detections(made, "box")))
    boxes = "has no masks for frame 7/3: 3 detections in det.json have a box but no mask; expected 'segm"
    assert boxes in refusal(made, masks=str(file))
    file.write_text(json.dumps([{**entry, "image_id": 4} for entry in detections(made)]))
    assert "has no masks for frame 7/3: its detections are of 7/4" in refusal(made, masks=str(file))
    file.write_text(json.dumps({"images": [], "annotations": detections(made), "categories": []}))
    coco = "holds images, annotations, categories as COCO has them; expected BOP's detections, a list: [{scene_id, im"
    assert coco in refusal(made, masks=str(file))


def test_an_empty_frame_says_that_it_is_empty(made: Made) -> None:
    made.edit("scene_gt.json", lambda c: c.update({"3": []}))
    assert refusal(made) == "frame 7/3 is empty: its ground truth (scene_gt.json) lists no object"


def test_object_ids_that_count_from_0_are_noted_where_files_give_them(tmp_path: Path) -> None:
    made, file, rows = make(tmp_path / "boxes"), tmp_path / "det.json", tmp_path / "rows.csv"
    for names in ("models/obj_000002.ply", "models/obj_000005.ply"):  # Objects 1 and 2, as others count.
        (made.root / names).rename(made.root / names.replace("2.ply", "1.ply").replace("5.ply", "2.ply"))
    for ids, is_noted in (((0, 1, 1), True), ((1, 2, 2), False), ((0, 5, 1), False)):
        entries = [{**entry, "category_id": i} for i, entry in zip(ids, detections(made), strict=True)]
        file.write_text(json.dumps(entries))
        rows.write_text("\n".join(f"7,3,{i},1.0,{POSE},-1" for i in ids))
        results = HypothesesSettings(source="results", files=(str(rows),))
        words = "its object ids are 0, 1, those of models 1, 2; where it counts from 0, all are one too small: add 1"
        for source in (made.open(masks=str(file)), made.open(results)):
            assert any(words in note for note in source.notes) == is_noted, (ids, source.notes)


def test_a_bad_line_of_a_results_file_is_left_out_and_the_first_is_named(tmp_path: Path) -> None:
    path, good = tmp_path / "est_x-test.csv", f"7,3,5,1.0,{POSE},-1"
    for line, words in (
        (f"7,3,5,nan,{POSE},-1", "line 3: score holds NaN or infinity"),
        (good.replace("1 0 0 0 1 0 0 0 1", "2 0 0 0 1 0 0 0 1"), "line 3: the pose is not rigid: det(R) = 2.000"),
        (good.replace("1 0 0 0 1", "1 0 0 1"), "line 3: R holds 8 numbers, expected 9"),
        (good[:-3], "line 3: found 6 comma-separated fields, expected 7"),
        ("", "line 3: found a blank line, expected 7 fields"),
        (good.replace("3", "3.0", 1), "line 3: im_id is '3.0', expected an integer"),
    ):
        path.write_text("\n".join([HEADER, good, line, good]))
        read = read_poses(path)
        assert len(read.rows) == 2
        (note,) = read.notes
        assert note.startswith(f"1 row of {path.name} cannot be used and is left out: {words}")
        with pytest.raises(InputError, match=re.escape(words)):  # It would be lost when the file is written again.
            read_results(path)
        path.write_text("\n".join([HEADER, good, line, line, good]))
        assert read_poses(path).notes[0].startswith(f"2 rows of {path.name} cannot be used and are left out; the first")
        path.write_text("\n".join([HEADER, HEADER, line]))
        with pytest.raises(InputError, match=re.escape(f"{path}: line 2: ")):
            read_poses(path)
    path.write_text("\n".join([HEADER.replace(",", ";"), good]))
    with pytest.raises(InputError, match=f"line 1: the header is .*, expected {HEADER} or none"):
        read_results(path)


def test_wrong_settings_are_one_line(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes")
    for scene, words in (
        ({"split": "val"}, "unknown split 'val'; available: test"),
        ({"frames": ("50",)}, 'frame \'50\' is not "scene/image", such as "50/1"'),
        ({"frames": ("50/1",)}, "unknown scene 50; available: 7"),
        ({"frames": ("7/9",)}, "unknown image 9 in scene 7 of boxes/test; available: 3"),
        ({"objects": (9,)}, "unknown object 9 in scene.objects; available: 2 (obj_000002), 5 (obj_000005)"),
        ({"masks": "mask_pred"}, "scene.masks is 'mask_pred', expected mask_visib, mask, or the path"),
    ):
        assert words in refusal(made, **scene)
    assert "hypotheses.files is empty" in refusal(made, HypothesesSettings(source="results"))


def test_a_folder_near_the_data_set_is_led_to_it(tmp_path: Path) -> None:
    make(tmp_path / "made").root.rename(tmp_path / "yc")
    for named in ("yc/test", "yc/test/000007", "."):
        made = Made(tmp_path / named, tmp_path, None, "7/3")  # type: ignore[arg-type]
        assert refusal(made).endswith(f"; the data set is {tmp_path}/yc: set scene.dataset to it")


def test_objects_that_no_chosen_frame_holds_are_named(made: Made) -> None:
    made.edit("scene_gt.json", lambda c: [e.update(obj_id=2) for e in c["3"]])
    there = "holds object 5 of scene.objects; objects there: 2 (obj_000002)"
    assert refusal(made, objects=(5,), frames=("7/3",)) == f"none of the chosen frames (7/3) {there}"
    assert refusal(made, objects=(5,)) == f"no frame of {made.root.name}/test {there}"
    assert made.open(objects=(5, 2)).notes[-1] == "no chosen frame holds object 5 (obj_000005) of scene.objects"


def test_two_of_one_number_are_refused(made: Made) -> None:
    shutil.copytree(made.scene, made.scene.with_name("8"))
    shutil.copytree(made.scene, made.scene.with_name("7"))
    assert "000007 and 7 are both scene 7; rename or remove one of them" in refusal(made, frames=("7/3",))
    assert made.open(frames=("8/3",)).problem("8/3").scene_id == 8
    shutil.copy(made.root / "models/obj_000005.ply", made.root / "models/obj_5.ply")
    assert "obj_000005.ply and obj_5.ply are both object 5; rename or remove one of them" in refusal(made)


def test_names_and_keys_with_more_or_fewer_zeros_are_the_same(tmp_path: Path) -> None:
    plain, other = make(tmp_path / "a"), make(tmp_path / "b")
    for made in (plain, other):
        (made.root / "models/obj_names.json").write_text(json.dumps({"5": "mug"}))
    files = [f"scene_{name}.json" for name in ("camera", "gt", "gt_info")]
    for file in (*files, "../../models/models_info.json", "../../models/obj_names.json"):
        other.edit(file, lambda c: [c.update({key.zfill(6): c.pop(key)}) for key in list(c)])
    (other.root / "models/obj_000005.ply").rename(other.root / "models/obj_5.ply")
    one, same = plain.read(), other.read()
    assert [i.visib_fract for i in same.instances] == [i.visib_fract for i in one.instances]
    assert same.models[5].name == "mug"
    assert same.models[5].mesh_hash == one.models[5].mesh_hash
    results = tmp_path / "r.csv"
    results.write_text(f"7,3,5,1,{POSE},-1\n7,3,2,1,{POSE},-1\n")
    scores = [evaluate_files([results], made.root).scores[0].recalls.ar for made in (plain, other)]
    assert scores[0] == scores[1]
