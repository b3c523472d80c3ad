"""Trouble with a BOP folder: one line that names the place, or a note; trouble with one object leaves the others."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes.bop_folder import POSE, Made, box_ply, cut, detections, image, make, refusal
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.source import open_scene

Spoil = Callable[[Made], Any]
MASK = "mask_visib/000003_000001.png"


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
    (lambda m: cut(m.scene / "depth/000003.png"), "depth/000003.png"),
    (lambda m: (m.scene / "depth/000003.png").unlink(), "depth/000003.png is missing"),
    (lambda m: image(m, "depth/000003.png", np.zeros((60, 80), np.uint16)), "is 0 everywhere"),
    (lambda m: image(m, "depth/000003.png", np.ones((60, 80, 3), np.uint8)), "is a RGB image"),
    (lambda m: image(m, "rgb/000003.png", np.ones((48, 64, 3), np.uint8)), "is 64×48 pixels"),
    (written("scene_camera.json", '{"3": {"cam_K": [1, 2,,]}}'), "scene_camera.json: not JSON"),
    (written("scene_camera.json", "[]"), "scene_camera.json: Expected `object`, got `array`"),
    (edited("scene_camera.json", lambda c: c["3"].pop("cam_K")), "scene_camera.json, image 3 has no 'cam_K'"),
    (edited("scene_camera.json", lambda c: c.update({"3": {"cam_model": {}}})), "'cam_model'"),
    (camera(cam_K=[1] * 8), "image 3: Expected 9 numbers, got 8 (at $.cam_K)"),
    (camera(cam_K=[90, 0, 0, 0, 90, 0, 40, 30, 1]), "column by column"),
    (camera(cam_K=[1e99, 0, 40, 0, 90, 30, 0, 0, 1]), "cam_K has focal lengths 1e+99, 90"),
    (camera(depth_scale=0), "$.depth_scale"),
    (lambda m: shutil.rmtree(m.scene / "mask_visib"), "mask_visib is missing"),
    (edited("scene_gt.json", lambda c: c.update({"3": []})), "frame 7/3 is empty"),
    (lambda m: (m.scene / "depth/000003.png").rename(m.scene / "depth/000003.exr"), "000003.exr: EXR"),
)  # fmt: skip
OBJECTS: tuple[tuple[Spoil, str], ...] = (
    (lambda m: image(m, MASK, np.full((64, 48), 255, np.uint8)), "is 48×64 pixels"),
    (lambda m: cut(m.root / "models/obj_000005.ply", 0.9), "of 12 faces"),
    (
        lambda m: (m.root / "models/obj_000005.ply").write_text(box_ply(m.problem).replace("3 0 1 3", "3 0 1 99", 1)),
        "object 5 is left out: ",
    ),
    (about_model(diameter=-3), "$.diameter"),
    (
        about_model(symmetries_continuous=[{"axis": [0, 0, 1], "offset": [0, 0, 1e30]}]),
        "symmetries_continuous[0]: 'offset' is 1e+27 m",
    ),
    (about_model(symmetries_continuous=[{}]), "`axis` (at $.symmetries_continuous[0])"),
)
NOTED: tuple[tuple[Spoil, str], ...] = (
    (truth(cam_R_m2c=[1, 0, 0, 0, 1, 0, 0, 0, -1]), "det(R) = -1.000"),
    (truth(cam_t_m2c=[0, 0, 1e30]), "'cam_t_m2c' is 1e+27 m"),
    (edited("scene_gt.json", lambda c: c["3"][1].pop("cam_R_m2c")), "entry 1 has no 'cam_R_m2c'"),
    (truth(cam_t_m2c=[float("nan"), 0, 1]), "image 3, entry 1: 'cam_t_m2c'"),
    (truth(cam_R_m2c=[1] * 8), "image 3, entry 1: 'cam_R_m2c'"),
)
FRAME_NOTED: tuple[tuple[Spoil, str], ...] = (
    (camera(cam_R_w2c=[2] * 9), "'cam_R_w2c' is not rigid"),
    (camera(cam_R_w2c=[float("nan")] * 9), "'cam_R_w2c': Expected finite numbers"),
    (camera(cam_R_w2c=np.eye(3).tolist(), cam_t_w2c=[1]), "'cam_t_w2c': Expected 3 numbers, got 1"),
    (lambda m: cut(m.scene / "rgb/000003.png"), "without colour"),
)
"""What a frame does without."""
SOURCE_NOTED: tuple[tuple[Spoil, str], ...] = (
    (edited("scene_camera.json", lambda c: c.update(left=1)), "'left'"),
    (edited("scene_gt.json", lambda c: c.update(left=1)), "'left'"),
    (edited("scene_gt.json", lambda c: c["3"][1].pop("obj_id")), "image 3, entry 1: 'obj_id'"),
    (truth(cam_t_m2c=[float("nan"), 0, 1]), "1 entry of the ground truth of 3/test"),
    (written("../../models/obj_names.json", '{"a": "b", "5": "mug"}'), "'a': 'b'"),
    (edited("../../models/models_info.json", lambda c: c.update(mug={})), "'mug'"),
    (edited("scene_gt_info.json", lambda c: c["3"][1].update(visib_fract="all")), ""),
    (lambda m: shutil.copytree(m.scene, m.scene.with_name("000008")) / "scene_camera.json", ""),
    (
        lambda m: (shutil.copytree(m.scene, m.scene.with_name("000008")) / "scene_camera.json").write_text("{"),
        "1 scene of 8/test",
    ),
)
"""What a data set does without: said once, when it is opened."""
TARGETS_NOTED: tuple[tuple[Spoil, str], ...] = (
    (written("../../test_targets_bop19.json", '[{"scene_id": 7}]'), "1 entry of test_targets_bop19.json"),
    (edited("../../test_targets_bop19.json", lambda c: c.append({"scene_id": 7, "im_id": 3})), "entry 2 has no"),
    (written("../../test_targets_bop19.json", "["), "bop19.json: not JSON: "),
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
    for k, (spoil, words) in enumerate((*SOURCE_NOTED, *TARGETS_NOTED)):
        made = make(tmp_path / f"source/{k}", targets=k >= len(SOURCE_NOTED))
        spoil(made)
        source = made.open()
        assert sum(words in note for note in source.notes) == bool(words), (words, source.notes)
        assert source.frames[0] == "7/3"
        assert {i.obj_id for i in source.problem("7/3").instances} >= {2}, words
        assert made.open(objects=(2,)).frames == source.frames, words


def test_one_bad_frame_does_not_close_a_data_set_in_which_objects_are_chosen(tmp_path: Path) -> None:
    made = make(tmp_path, targets=False)
    for file in ("scene_camera.json", "scene_gt.json"):
        made.edit(file, lambda c: c.update({"4": c["3"]}))
    made.edit("scene_gt.json", lambda c: c.update({"3": "none"}))
    source = made.open(objects=(5,))
    assert source.frames == ("7/4",)
    assert sum("image 3: " in note for note in source.notes) == 1


def test_a_principal_point_outside_of_the_image_is_noted(made: Made) -> None:
    for cx, cy, is_noted in ((-1, 30, True), (80, 30, True), (40, 60, True), (0, 0, False), (79, 59, False)):
        camera(cam_K=[90, 0, cx, 0, 90, cy, 0, 0, 1])(made)
        assert any(f" {cx}, {cy} px" in note for note in made.read().notes) == is_noted


def test_trouble_with_detections(made: Made, tmp_path: Path) -> None:
    file = tmp_path / "det.json"
    for change, words in (
        ({"segmentation": {"size": [80, 60], "counts": [4800]}}, "[80, 60]"),
        ({"segmentation": {"size": [60, 80], "counts": [9]}}, "expected a sum of 4800 pixels"),
        ({"segmentation": [[1, 2, 3, 4]]}, "'segmentation': Expected `object`, got `array`"),
        ({"score": "high"}, "(at $.score)"),
        ({"category_id": "mug"}, "(at $.category_id)"),
    ):
        entries = detections(made)
        entries[1].update(change)
        file.write_text(json.dumps(entries))
        source = made.open(masks=str(file))
        problem = source.problem(made.frame)
        assert sum(words in note for note in (*source.notes, *problem.notes)) == 1, (source.notes, problem.notes)
        assert [i.obj_id for i in problem.instances] == [2, 2]
        file.write_text(json.dumps(entries[1:2]))
        assert words in refusal(made, masks=str(file))
    file.write_text(json.dumps(detections(made)))
    made.edit("scene_gt.json", lambda c: c.update({"3": "none"}))
    problem = made.read(masks=str(file))  # Which does without ground truth.
    assert len(problem.instances) == 3
    assert any("no ground truth" in note for note in problem.notes)
    others = [{**entry, "image_id": 4} for entry in detections(made)]
    of_coco = {"images": [], "annotations": detections(made), "categories": []}
    for content, words in ((detections(made, "box"), "3 detections"), (others, "7/4"), (of_coco, "COCO")):
        file.write_text(json.dumps(content))
        assert words in refusal(made, masks=str(file))


def test_object_ids_that_count_from_0_are_noted_where_files_give_them(tmp_path: Path) -> None:
    made, file, rows = make(tmp_path / "boxes"), tmp_path / "det.json", tmp_path / "rows.csv"
    for names in ("models/obj_000002.ply", "models/obj_000005.ply"):  # Objects 1 and 2, as others count.
        (made.root / names).rename(made.root / names.replace("2.ply", "1.ply").replace("5.ply", "2.ply"))
    for ids, is_noted in (((0, 1, 1), True), ((1, 2, 2), False), ((0, 5, 1), False)):
        entries = [{**entry, "category_id": i} for i, entry in zip(ids, detections(made), strict=True)]
        file.write_text(json.dumps(entries))
        rows.write_text("\n".join(f"7,3,{i},1.0,{POSE},-1" for i in ids))
        results = HypothesesSettings(source="results", files=(str(rows),))
        for source in (made.open(masks=str(file)), made.open(results)):
            assert any("object ids are 0, 1" in note for note in source.notes) == is_noted, (ids, source.notes)


def test_wrong_settings_are_one_line(made: Made) -> None:
    for scene, words in (
        ({"split": "val"}, "'val'; available: test"),
        ({"frames": ("50",)}, "'50'"),
        ({"frames": ("50/1",)}, "50; available: 7"),
        ({"frames": ("7/9",)}, "available: 3"),
        ({"objects": (9,)}, "available: 2 (obj_000002), 5 (obj_000005)"),
        ({"masks": "mask_pred"}, "'mask_pred'"),
    ):
        assert words in refusal(made, **scene)
    assert "hypotheses.files" in refusal(made, HypothesesSettings(source="results"))
    made.edit("scene_gt.json", lambda c: [e.update(obj_id=2) for e in c["3"]])
    for scene in ({"frames": ("7/3",)}, {}):
        assert "object 5 of scene.objects" in refusal(made, objects=(5,), **scene)
    assert "object 5 (obj_000005)" in made.open(objects=(5, 2)).notes[-1]


def test_two_of_one_number_are_refused(made: Made) -> None:
    shutil.copytree(made.scene, made.scene.with_name("8"))
    shutil.copytree(made.scene, made.scene.with_name("7"))
    assert "000007 and 7 are both scene 7" in refusal(made, frames=("7/3",))
    assert made.open(frames=("8/3",)).problem("8/3").scene_id == 8
    shutil.copy(made.root / "models/obj_000005.ply", made.root / "models/obj_5.ply")
    assert "obj_000005.ply and obj_5.ply are both object 5" in refusal(made)


def test_a_folder_near_the_data_set_is_led_to_it(tmp_path: Path) -> None:
    make(tmp_path / "made").root.rename(tmp_path / "yc")
    for named in ("yc/test", "yc/test/000007", "."):
        made = Made(tmp_path / named, tmp_path, None, "7/3")  # type: ignore[arg-type]
        assert f"the data set is {tmp_path}/yc:" in refusal(made)


NEAR = (
    ("depth/000003.png", "depth/000003.raw"),
    ("depth/000003.png", "depth/frame_3.png"),
    ("depth", "Depth"),
    ("mask_visib", "masks_visib"),
    ("../../models", "../../model"),
    ("scene_camera.json", "scene_camera.json.gz"),
    ("scene_gt.json", "scene_gts.json"),
)
"""Files and folders, and names that are nearly theirs."""


def test_what_lies_beside_a_missing_file_is_named(made: Made, tmp_path: Path) -> None:
    for k, (old, new) in enumerate(NEAR):
        near = make(tmp_path / str(k))
        (near.scene / old).rename(near.scene / new)
        assert f"there is {Path(new).name}" in refusal(near)
        with pytest.raises(VerefineError, match=f"there is {Path(new).name}"):
            Toolbox(open_session(near.root, {})).problem("7/3")
    noted = ("rgb/000003.png", "rgb/3.png"), ("mask_visib/000003_000000.png", "mask_visib/3_0.png")
    for old, new in (*noted, ("../../models/obj_000005.ply", "../../models/5.ply")):
        (made.scene / old).rename(made.scene / new)
    problem = made.read()
    assert [i.instance_id for i in problem.instances] == [2]
    for name in ("3.png", "3_0.png", "5.ply"):
        assert any(f"there is {name}" in note for note in problem.notes), (name, problem.notes)
    (made.scene / "depth/000003.png").rename(made.scene / "depth/000013.png")
    assert "there is" not in refusal(made)
    (made.scene / "scene_gt.json").unlink()  # scene_gt_info.json is another file.
    assert "there is" not in refusal(made)


# What cannot be solved is left out by name, so that it can be counted as missed.


def facts(left_out: tuple[LeftOut, ...]) -> list[tuple[int | None, int, bool, float | None]]:
    return [(one.instance_id, one.obj_id, one.has_truth, one.visib_fract) for one in left_out]


def empty_mask(made: Made) -> None:
    image(made, "mask_visib/000003_000001.png", np.zeros((60, 80), np.uint8))


@pytest.mark.parametrize("what", ["missing", "damaged", "empty"])
def test_a_mask_that_cannot_be_used(made: Made, what: str) -> None:
    file = made.scene / "mask_visib" / "000003_000001.png"
    {"missing": lambda: file.unlink(), "damaged": lambda: cut(file), "empty": lambda: empty_mask(made)}[what]()
    problem = made.read()
    assert [i.instance_id for i in problem.instances] == [0, 2]
    assert facts(problem.left_out) == [(1, 5, True, 0.6)]
    assert ("60%" if what == "empty" else file.name) in problem.left_out[0].why
    assert problem.left_out[0].is_unreadable == (what != "empty")
    assert [note for note in problem.notes if "obj_000005 (#1)" in note]


def test_what_nobody_can_see_is_not_missed(made: Made) -> None:
    made.edit("scene_gt_info.json", lambda info: info["3"][1].update(visib_fract=0.0))
    empty_mask(made)
    assert made.read().left_out == ()
    assert facts(made.open().all_left_out(made.frame, "no depth")) == [(0, 2, True, 0.5), (2, 2, True, 0.7)]
    (made.scene / "scene_gt_info.json").unlink()  # An empty mask is believed where nothing else is known.
    assert made.read().left_out == ()


def test_a_model_that_is_missing_or_damaged(made: Made) -> None:
    file = made.root / "found.json"
    file.write_text(json.dumps(detections(made)))
    (made.root / "models" / "obj_000005.ply").unlink()
    problem = made.read()
    assert facts(problem.left_out) == [(1, 5, True, 0.6)]
    assert problem.left_out[0].is_unreadable
    np.testing.assert_array_equal(problem.observation.object_mask, made.problem.observation.object_mask)
    shutil.copy(made.root / "models" / "obj_000002.ply", made.root / "models" / "obj_000005.ply")
    (made.root / "models" / "obj_000002.ply").write_bytes(b"ply\nrubbish")
    problem = made.read(masks=str(file))
    assert [i.obj_id for i in problem.instances] == [5]
    assert [(one.obj_id, one.has_truth, one.is_unreadable) for one in problem.left_out] == [(2, True, True)] * 2


def test_what_was_not_detected(made: Made) -> None:
    file = made.root / "found.json"
    file.write_text(json.dumps(detections(made)[:2]))
    problem = made.read(masks=str(file))
    assert [i.obj_id for i in problem.instances] == [2, 5]
    assert facts(problem.left_out) == [(None, 2, True, 0.7)]
    assert (problem.left_out[0].why, problem.left_out[0].is_unreadable) == ("it was not detected", False)
    assert facts(made.open(masks=str(file)).all_left_out(made.frame, "")) == [
        (None, 2, True, 0.5), (None, 5, True, 0.6), (None, 2, True, 0.7)
    ]  # fmt: skip


def test_a_pose_that_is_no_pose_is_no_truth(made: Made) -> None:
    made.edit("scene_gt.json", lambda gt: gt["3"][1].pop("cam_R_m2c"))
    assert facts(made.open().all_left_out(made.frame, ""))[1] == (1, 5, False, 0.6)


def test_a_frame_that_cannot_be_read_held_what_ground_truth_says(made: Made) -> None:
    (made.scene / "depth" / "000003.png").unlink()
    source = made.open(objects=(2,))
    with pytest.raises(InputError):
        source.problem(made.frame)
    left_out = source.all_left_out(made.frame, "no depth")
    assert facts(left_out) == [(0, 2, True, 0.5), (2, 2, True, 0.7)]
    assert {one.why for one in left_out} == {"no depth"}
    (made.scene / "scene_gt.json").unlink()
    assert made.open().all_left_out(made.frame, "no depth") == ()


@pytest.mark.usefixtures("processes")
def test_a_built_in_scene_knows_its_objects() -> None:
    source = open_scene(SceneSettings(), HypothesesSettings())
    (one,) = source.all_left_out("0/0", "a crash")
    assert (one.instance_id, one.name, one.why, one.has_truth) == (0, "mug", "a crash", True)
