"""Bad input says in one line what was wrong, what was expected and how to mend it; a single bad instance is a note."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes.bop_folder import Made, box_ply, cut, detections, image, make, refusal
from verefine_viz.core.errors import VerefineError

Spoil = Callable[[Made], Any]


FRAME_TROUBLE: dict[str, tuple[Spoil, list[str]]] = {
    "truncated depth": (lambda m: cut(m.scene / "depth/000003.png"), ["depth/000003.png is damaged", "fetch it again"]),
    "truncated rgb": (lambda m: cut(m.scene / "rgb/000003.png"), ["rgb/000003.png is damaged", "fetch it again"]),
    "depth is text": (
        lambda m: (m.scene / "depth/000003.png").write_text("hello"),
        ["depth/000003.png is damaged or no image"],
    ),
    "depth missing": (
        lambda m: (m.scene / "depth/000003.png").unlink(),
        ["depth/000003.png is missing", "a depth image is needed"],
    ),
    "depth all zero": (
        lambda m: image(m, "depth/000003.png", np.zeros((60, 80), np.uint16)),
        ["is 0 everywhere", "no depth"],
    ),
    "depth in colour": (
        lambda m: image(m, "depth/000003.png", np.ones((60, 80, 3), np.uint8)),
        ["is a RGB image", "expected one channel"],
    ),
    "rgb of another size": (
        lambda m: image(m, "rgb/000003.png", np.ones((48, 64, 3), np.uint8)),
        ["rgb/000003.png is 64×48 pixels", "depth image is 80×60"],
    ),
    "camera file missing": (
        lambda m: (m.scene / "scene_camera.json").unlink(),
        ["scene_camera.json does not exist"],
    ),
    "camera file not JSON": (
        lambda m: (m.scene / "scene_camera.json").write_text('{"3": {"cam_K": [1, 2,,]}}'),
        ["scene_camera.json is not JSON", "line 1, column"],
    ),
    "camera file binary": (
        lambda m: (m.scene / "scene_camera.json").write_bytes(b"\xff\xfe\x00\x81"),
        ["scene_camera.json is not JSON"],
    ),
    "camera file is a list": (
        lambda m: (m.scene / "scene_camera.json").write_text("[]"),
        ["holds a JSON list, expected an object"],
    ),
    "camera keys are words": (
        lambda m: m.edit("scene_camera.json", lambda c: c.update(left=1)),
        ["scene_camera.json has 'left' for an image, expected its number"],
    ),
    "camera entry is a list": (
        lambda m: m.edit("scene_camera.json", lambda c: c.update({"3": [1]})),
        ["image 3 is a JSON list, expected an object with 'cam_K'"],
    ),
    "no cam_K": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].pop("cam_K")),
        ["image 3 has no 'cam_K'; it has depth_scale"],
    ),
    "fisheye": (
        lambda m: m.edit("scene_camera.json", lambda c: c.update({"3": {"cam_model": {}}})),
        ["'cam_model' (fisheye)", "only pinhole"],
    ),
    "cam_K of 8": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"]["cam_K"].pop()),
        ["'cam_K' holds 8 numbers, expected 9"],
    ),
    "cam_K of words": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].update(cam_K=["a"] * 9)),
        ["'cam_K' does not hold numbers, expected 9"],
    ),
    "cam_K column by column": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].update(cam_K=[90, 0, 0, 0, 90, 0, 40, 30, 1])),
        ["the last row of 'cam_K' is 40 30 1, expected 0 0 1; it looks written column by column: write it row by row"],
    ),
    "cam_K with another last row": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].update(cam_K=[90, 0, 40, 0, 90, 30, 0, 0, 0])),
        ["the last row of 'cam_K' is 0 0 0, expected 0 0 1"],
    ),
    "focal length 0": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].update(cam_K=[0] * 8 + [1])),
        ["focal lengths 0, 0; expected positive"],
    ),
    "no depth_scale": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].pop("depth_scale")),
        ["has no 'depth_scale'; it has cam_K"],
    ),
    "depth_scale 0": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].update(depth_scale=0)),
        ["'depth_scale' is 0, expected"],
    ),
    "depth_scale too large": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].update(depth_scale=1e37)),
        ["'depth_scale' is 1e+37, expected millimetres per step > 0, 1e-06 to 10000"],
    ),
    "depth_scale too small": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].update(depth_scale=1e-300)),
        ["'depth_scale' is 1e-300, expected millimetres per step > 0, 1e-06 to 10000"],
    ),
    "depth too deep": (
        lambda m: [
            (m.scene / "depth/000003.png").unlink(),
            image(m, "depth/000003.tif", np.full((60, 80), 1e30, np.float32)),
        ],
        ["holds depth of 1e+26 m at 0.1 mm a step, expected at most 1e+06 m; check 'depth_scale'"],
    ),
    "camera pose no rotation": (
        lambda m: m.edit("scene_camera.json", lambda c: c["3"].update(cam_R_w2c=[2] * 9)),
        ["'cam_R_w2c' is not rigid"],
    ),
    "gt not JSON": (lambda m: cut(m.scene / "scene_gt.json"), ["scene_gt.json is not JSON"]),
    "gt entry without obj_id": (
        lambda m: m.edit("scene_gt.json", lambda c: c["3"][1].pop("obj_id")),
        ["image 3, entry 1 has no 'obj_id'"],
    ),
    "gt entry is a number": (
        lambda m: m.edit("scene_gt.json", lambda c: c.update({"3": 4})),
        ["image 3 is a JSON int, expected a list of instances"],
    ),
    "gt of no instance": (
        lambda m: m.edit("scene_gt.json", lambda c: c.update({"3": []})),
        ["no mask of object any"],
    ),
    "gt_info without visib_fract": (
        lambda m: m.edit("scene_gt_info.json", lambda c: c["3"][2].pop("visib_fract")),
        ["entry 2 has no 'visib_fract'"],
    ),
    "all masks missing": (
        lambda m: [p.unlink() for p in (m.scene / "mask_visib").iterdir()],
        ["no instance of frame 7/3 has a mask", "set scene.masks to a detections JSON"],
    ),
    "no mask folder": (
        lambda m: (m.scene / "mask_visib").rename(m.scene / "elsewhere"),
        ["mask_visib is missing; set scene.masks to 'mask'"],
    ),
    "targets entry incomplete": (
        lambda m: (m.root / "test_targets_bop19.json").write_text('[{"scene_id": 7}]'),
        ["test_targets_bop19.json, entry 0 has no 'im_id'; it has scene_id"],
    ),
    "models_info not JSON": (
        lambda m: (m.root / "models/models_info.json").write_text("{"),
        ["models_info.json is not JSON"],
    ),
    "names without ids": (
        lambda m: (m.root / "models/obj_names.json").write_text('{"a": "b"}'),
        ["obj_names.json", "does not name an object id"],
    ),
    "no models": (
        lambda m: (m.root / "models").rename(m.root / "meshes"),
        ["has no object models; expected models/obj_000001.ply"],
    ),
    "all models damaged": (
        lambda m: [cut(m.root / f"models/obj_00000{i}.ply") for i in (2, 5)],
        ["no instance of frame 7/3 can be solved: object 2 is left out", "holds no triangles"],
    ),
}


@pytest.mark.parametrize("case", FRAME_TROUBLE)
def test_trouble_with_a_frame_is_one_clear_line(tmp_path: Path, case: str) -> None:
    spoil, words = FRAME_TROUBLE[case]
    made = make(tmp_path)
    spoil(made)
    text = refusal(made)
    for word in words:
        assert word in text


INSTANCE_TROUBLE: dict[str, tuple[Spoil, str, list[int]]] = {
    "truncated mask": (
        lambda m: cut(m.scene / "mask_visib/000003_000001.png"),
        "obj_000005 (#1) is left out: ",
        [0, 2],
    ),
    "mask of another size": (
        lambda m: image(m, "mask_visib/000003_000001.png", np.full((64, 48), 255, np.uint8)),
        "000003_000001.png is 48×64 pixels, expected 80×60 as the depth image",
        [0, 2],
    ),
    "empty mask": (
        lambda m: image(m, "mask_visib/000003_000001.png", np.zeros((60, 80), np.uint8)),
        "obj_000005 (#1) is left out: its mask is empty",
        [0, 2],
    ),
    "pose with NaN": (
        lambda m: m.edit("scene_gt.json", lambda c: c["3"][1].update(cam_t_m2c=[float("nan"), 0, 1])),
        "obj_000005 (#1) has no ground truth: ",
        [0, 1, 2],
    ),
    "pose no rotation": (
        lambda m: m.edit("scene_gt.json", lambda c: c["3"][1].update(cam_R_m2c=[1, 0, 0, 0, 1, 0, 0, 0, -1])),
        "the pose is not rigid: det(R) = -1.000",
        [0, 1, 2],
    ),
    "pose behind the camera": (
        lambda m: m.edit("scene_gt.json", lambda c: c["3"][1].update(cam_t_m2c=[0, 0, 0])),
        "obj_000005 (#1): its ground truth lies behind the camera",
        [0, 1, 2],
    ),
    "pose out of reach": (
        lambda m: m.edit("scene_gt.json", lambda c: c["3"][1].update(cam_t_m2c=[0, 0, 1e30])),
        "entry 1: 'cam_t_m2c' is 1e+27 m away, expected at most 100 m; is it in millimetres?",
        [0, 1, 2],
    ),
    "pose incomplete": (
        lambda m: m.edit("scene_gt.json", lambda c: c["3"][1].pop("cam_R_m2c")),
        "entry 1 has no 'cam_R_m2c'",
        [0, 1, 2],
    ),
    "model truncated": (
        lambda m: cut(m.root / "models/obj_000005.ply"),
        "object 5 is left out: ",
        [0, 2],
    ),
    "model cut off among its faces": (
        lambda m: cut(m.root / "models/obj_000005.ply", 0.9),
        "of 12 faces; fetch it again",
        [0, 2],
    ),
    "model without triangles": (
        lambda m: (m.root / "models/obj_000005.ply").write_text(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            "end_header\n0 0 0\n"
        ),
        "holds no triangles; a triangle mesh is expected, not a point cloud",
        [0, 2],
    ),
    "model with NaN": (
        lambda m: (m.root / "models/obj_000005.ply").write_text(box_ply(m.problem).replace("-50 ", "nan ", 1)),
        "obj_000005.ply holds vertices that are NaN or infinite",
        [0, 2],
    ),
    "faces without vertices": (
        lambda m: (m.root / "models/obj_000005.ply").write_text(box_ply(m.problem).replace("3 0 1 3", "3 0 1 99")),
        "object 5 is left out: ",
        [0, 2],
    ),
    "diameter negative": (
        lambda m: m.edit("../../models/models_info.json", lambda c: c["5"].update(diameter=-3)),
        "object 5: 'diameter' is -3, expected millimetres > 0",
        [0, 2],
    ),
    "diameter too large": (
        lambda m: m.edit("../../models/models_info.json", lambda c: c["5"].update(diameter=1e30)),
        "object 5: 'diameter' is 1e+30, expected millimetres > 0, 0.001 to 1e+06",
        [0, 2],
    ),
    "vertex too far": (
        lambda m: (m.root / "models/obj_000005.ply").write_text(box_ply(m.problem).replace("-50 ", "1e30 ", 1)),
        "has a vertex at 1e+30, expected coordinates within ±1e+09",
        [0, 2],
    ),
    "symmetry out of reach": (
        lambda m: m.edit(
            "../../models/models_info.json",
            lambda c: c["5"].update(symmetries_continuous=[{"axis": [0, 0, 1], "offset": [0, 0, 1e30]}]),
        ),
        "symmetries_continuous[0]: 'offset' is 1e+27 m away, expected at most 100 m",
        [0, 2],
    ),
    "discrete symmetry out of reach": (
        lambda m: m.edit(
            "../../models/models_info.json",
            lambda c: c["5"].update(symmetries_discrete=[[1, 0, 0, 1e30, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]]),
        ),
        "symmetries_discrete[0] is 1e+27 m away, expected at most 100 m",
        [0, 2],
    ),
    "mask of one pixel": (
        lambda m: image(m, "mask_visib/000003_000001.png", np.eye(1, 4800, 2000, dtype=np.uint8).reshape(60, 80)),
        "obj_000005 (#1): its mask covers 1 px, too few to find a pose; expected at least 10",
        [0, 1, 2],
    ),
    "diameter a word": (
        lambda m: m.edit("../../models/models_info.json", lambda c: c["5"].update(diameter="big")),
        "object 5: 'diameter' is 'big', expected a finite number",
        [0, 2],
    ),
    "symmetry mirrors": (
        lambda m: m.edit(
            "../../models/models_info.json",
            lambda c: c["5"].update(symmetries_discrete=[np.diag([-1, 1, 1, 1]).ravel().tolist()]),
        ),
        "object 5: symmetries_discrete[0] is not rigid",
        [0, 2],
    ),
    "symmetry of 15 numbers": (
        lambda m: m.edit("../../models/models_info.json", lambda c: c["5"].update(symmetries_discrete=[[1.0] * 15])),
        "holds 15 numbers, expected 16",
        [0, 2],
    ),
    "symmetry without axis": (
        lambda m: m.edit("../../models/models_info.json", lambda c: c["5"].update(symmetries_continuous=[{}])),
        "symmetries_continuous[0] has no 'axis'",
        [0, 2],
    ),
    "no depth in one mask": (
        lambda m: image(
            m,
            "depth/000003.png",
            np.where(m.problem.instances[1].mask, 0, m.problem.observation.depth_m * 1e4).astype(np.uint16),
        ),
        "obj_000005 (#1) has no depth inside its mask",
        [0, 1, 2],
    ),
}


@pytest.mark.parametrize("case", INSTANCE_TROUBLE)
def test_trouble_with_an_instance_is_a_note_and_the_others_go_on(tmp_path: Path, case: str) -> None:
    spoil, words, left = INSTANCE_TROUBLE[case]
    made = make(tmp_path)
    spoil(made)
    problem = made.read()
    assert [i.instance_id for i in problem.instances] == left
    assert any(words in note for note in problem.notes), problem.notes
    assert all("\n" not in note for note in problem.notes)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ({"split": "val"}, ["unknown split 'val'; available: test"]),
        ({"split": "../test"}, ["unknown split '../test'; did you mean 'test'? available: test"]),
        ({"frames": ("50",)}, ['frame \'50\' is not "scene/image", such as "50/1"']),
        ({"frames": ("a/b",)}, ['is not "scene/image"']),
        ({"frames": ("7/-3",)}, ['is not "scene/image"']),
        ({"frames": ("9" * 5000 + "/3",)}, ['is not "scene/image"']),
        ({"frames": ("7/3/1",)}, ['is not "scene/image"']),
        ({"frames": ("50/1",)}, ["unknown scene 50; available: 7"]),
        ({"frames": ("7/9",)}, ["unknown image 9 in scene 7", "available: 3"]),
        ({"objects": (9,)}, ["unknown object 9 in scene.objects; available: 2 (obj_000002), 5 (obj_000005)"]),
        ({"masks": "mask_pred"}, ["scene.masks is 'mask_pred', expected mask_visib, mask, or the path"]),
        ({"masks": "/nowhere/det.json"}, ["/nowhere/det.json does not exist"]),
    ],
)
def test_wrong_settings_are_one_clear_line(tmp_path: Path, scene: dict[str, Any], words: list[str]) -> None:
    text = refusal(make(tmp_path), **scene)
    for word in words:
        assert word in text


def test_of_many_objects_the_ids_are_shown_as_ranges(tmp_path: Path) -> None:
    made = make(tmp_path)
    model = (made.root / "models" / "obj_000002.ply").read_bytes()
    for obj_id in (*range(1, 22), 30):
        (made.root / "models" / f"obj_{obj_id:06d}.ply").write_bytes(model)
    assert refusal(made, objects=(99,)) == "unknown object 99 in scene.objects; available: 1-21, 30"


def test_of_many_images_the_ids_are_shown_as_ranges(tmp_path: Path) -> None:
    made = make(tmp_path)
    made.edit("scene_camera.json", lambda content: content.update({str(k): content["3"] for k in range(4, 60)}))
    assert refusal(made, frames=("7/99",)).endswith("available: 3-59")


def test_an_unknown_frame_asked_for_later_is_refused_too(tmp_path: Path) -> None:
    source = make(tmp_path).open()
    for frame, words in (("7/4", "unknown image 4"), ("8/3", "unknown scene 8"), ("x", 'is not "scene/image"')):
        with pytest.raises(VerefineError, match=words):
            source.problem(frame)


def test_a_known_object_that_is_not_in_the_named_frame(tmp_path: Path) -> None:
    made = make(tmp_path)
    made.edit("scene_gt.json", lambda c: [e.update(obj_id=2) for e in c["3"]])
    there = "holds object 5 of scene.objects; objects there: 2 (obj_000002)"
    assert refusal(made, objects=(5,), frames=("7/3",)) == f"none of the chosen frames (7/3) {there}"
    assert refusal(made, objects=(5,)) == f"no frame of {made.root.name}/test {there}"


def test_an_object_that_only_some_of_the_named_frames_hold(tmp_path: Path) -> None:
    made = make(tmp_path)
    made.edit("scene_camera.json", lambda c: c.update({"4": c["3"]}))
    made.edit("scene_gt.json", lambda c: c.update({"4": [e for e in c["3"] if e["obj_id"] == 2]}))
    source = made.open(objects=(5,), frames=("7/4", "7/3"))
    assert source.frames == ("7/4", "7/3")
    assert source.notes == ()
    assert [i.obj_id for i in source.problem("7/3").instances] == [5]


def test_an_object_that_no_frame_holds_beside_one_that_is_there_is_named(tmp_path: Path) -> None:
    made = make(tmp_path)
    made.edit("scene_gt.json", lambda c: [e.update(obj_id=2) for e in c["3"]])
    for frames in ((), ("7/3",)):
        notes = made.open(objects=(5, 2), frames=frames).notes
        assert notes[-1:] == ("no chosen frame holds object 5 (obj_000005) of scene.objects",)


def test_where_nobody_knows_what_a_frame_holds_its_own_trouble_is_reported(tmp_path: Path) -> None:
    made = make(tmp_path)
    (made.scene / "scene_gt.json").unlink()
    assert "has no scene_gt, so its masks have no object ids" in refusal(made, objects=(5,), frames=("7/3",))


def test_a_detected_object_that_is_not_in_the_ground_truth(tmp_path: Path) -> None:
    made = make(tmp_path)
    file = tmp_path / "detections.json"
    file.write_text(json.dumps(detections(made)))
    made.edit("scene_gt.json", lambda c: [e.update(obj_id=2) for e in c["3"]])
    said = refusal(made, objects=(5,), frames=("7/3",), masks=str(file))
    assert said.startswith("none of the chosen frames (7/3) holds object 5 of scene.objects; objects there: 2 ")
