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


def ply(old: str, new: str) -> Spoil:
    """Another number in the mesh of object 5."""
    return lambda made: (made.root / "models/obj_000005.ply").write_text(box_ply(made.problem).replace(old, new, 1))


FRAME_TROUBLE: dict[str, tuple[Spoil, list[str]]] = {
    "truncated depth": (lambda m: cut(m.scene / "depth/000003.png"), ["depth/000003.png is damaged", "fetch it again"]),
    "truncated rgb": (lambda m: cut(m.scene / "rgb/000003.png"), ["rgb/000003.png is damaged", "fetch it again"]),
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
    "camera file not JSON": (
        written("scene_camera.json", '{"3": {"cam_K": [1, 2,,]}}'),
        ["scene_camera.json is not JSON", "line 1, column"],
    ),
    "camera file is a list": (written("scene_camera.json", "[]"), ["holds a JSON list, expected an object"]),
    "camera keys are words": (
        edited("scene_camera.json", lambda c: c.update(left=1)),
        ["scene_camera.json has 'left' for an image, expected its number"],
    ),
    "camera entry is a list": (
        edited("scene_camera.json", lambda c: c.update({"3": [1]})),
        ["image 3 is a JSON list, expected an object with 'cam_K'"],
    ),
    "no cam_K": (
        edited("scene_camera.json", lambda c: c["3"].pop("cam_K")),
        ["image 3 has no 'cam_K'; it has depth_scale"],
    ),
    "fisheye": (
        edited("scene_camera.json", lambda c: c.update({"3": {"cam_model": {}}})),
        ["'cam_model' (fisheye)", "only pinhole"],
    ),
    "cam_K of 8": (camera(cam_K=[1] * 8), ["'cam_K' holds 8 numbers, expected 9"]),
    "cam_K of words": (camera(cam_K=["a"] * 9), ["'cam_K' does not hold numbers, expected 9"]),
    "cam_K column by column": (
        camera(cam_K=[90, 0, 0, 0, 90, 0, 40, 30, 1]),
        ["the last row of 'cam_K' is 40 30 1, expected 0 0 1; it looks written column by column: write it row by row"],
    ),
    "cam_K with another last row": (
        camera(cam_K=[90, 0, 40, 0, 90, 30, 0, 0, 0]),
        ["the last row of 'cam_K' is 0 0 0, expected 0 0 1"],
    ),
    "depth_scale 0": (camera(depth_scale=0), ["'depth_scale' is 0, expected"]),
    "depth too deep": (
        lambda m: [
            (m.scene / "depth/000003.png").unlink(),
            image(m, "depth/000003.tif", np.full((60, 80), 1e30, np.float32)),
        ],
        ["holds depth of 1e+26 m at 0.1 mm a step, expected at most 1e+06 m; check 'depth_scale'"],
    ),
    "camera pose no rotation": (camera(cam_R_w2c=[2] * 9), ["'cam_R_w2c' is not rigid"]),
    "gt entry without obj_id": (
        edited("scene_gt.json", lambda c: c["3"][1].pop("obj_id")),
        ["image 3, entry 1 has no 'obj_id'"],
    ),
    "gt entry is a number": (
        edited("scene_gt.json", lambda c: c.update({"3": 4})),
        ["image 3 is a JSON int, expected a list of instances"],
    ),
    "gt of no instance": (edited("scene_gt.json", lambda c: c.update({"3": []})), ["no mask of object any"]),
    "gt_info without visib_fract": (
        edited("scene_gt_info.json", lambda c: c["3"][2].pop("visib_fract")),
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
        written("../../test_targets_bop19.json", '[{"scene_id": 7}]'),
        ["test_targets_bop19.json, entry 0 has no 'im_id'; it has scene_id"],
    ),
    "names without ids": (
        written("../../models/obj_names.json", '{"a": "b"}'),
        ["obj_names.json", "does not name an object id"],
    ),
    "all models damaged": (
        lambda m: [cut(m.root / f"models/obj_00000{i}.ply") for i in (2, 5)],
        ["no instance of frame 7/3 can be solved: object 2 is left out", "holds no triangles"],
    ),
}


def test_trouble_with_a_frame_is_one_clear_line(tmp_path: Path) -> None:
    for case, (spoil, words) in FRAME_TROUBLE.items():
        made = make(tmp_path / case)
        spoil(made)
        text = refusal(made)
        assert all(word in text for word in words), (case, text)


MASK_TROUBLE: dict[str, tuple[Spoil, str]] = {
    "truncated mask": (lambda m: cut(m.scene / "mask_visib/000003_000001.png"), "obj_000005 (#1) is left out: "),
    "mask of another size": (
        lambda m: image(m, "mask_visib/000003_000001.png", np.full((64, 48), 255, np.uint8)),
        "000003_000001.png is 48×64 pixels, expected 80×60 as the depth image",
    ),
    "empty mask": (
        lambda m: image(m, "mask_visib/000003_000001.png", np.zeros((60, 80), np.uint8)),
        "obj_000005 (#1) is left out: its mask is empty",
    ),
}
MODEL_TROUBLE: dict[str, tuple[Spoil, str]] = {
    "model truncated": (lambda m: cut(m.root / "models/obj_000005.ply"), "object 5 is left out: "),
    "model cut off among its faces": (
        lambda m: cut(m.root / "models/obj_000005.ply", 0.9),
        "of 12 faces; fetch it again",
    ),
    "model without triangles": (
        written(
            "../../models/obj_000005.ply",
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            "end_header\n0 0 0\n",
        ),
        "holds no triangles; a triangle mesh is expected, not a point cloud",
    ),
    "model with NaN": (ply("-50 ", "nan "), "obj_000005.ply holds vertices that are NaN or infinite"),
    "vertex too far": (ply("-50 ", "1e30 "), "has a vertex at 1e+30, expected coordinates within ±1e+09"),
    "faces without vertices": (ply("3 0 1 3", "3 0 1 99"), "object 5 is left out: "),
    "no object in models_info": (
        edited("../../models/models_info.json", lambda c: c.update({"5": 3})),
        "is a JSON int, expected an object with 'diameter'",
    ),
    "diameter negative": (about_model(diameter=-3), "object 5: 'diameter' is -3, expected millimetres > 0"),
    "diameter too large": (
        about_model(diameter=1e30),
        "object 5: 'diameter' is 1e+30, expected millimetres > 0, 0.001 to 1e+06",
    ),
    "diameter a word": (about_model(diameter="big"), "object 5: 'diameter' is 'big', expected a finite number"),
    "symmetry out of reach": (
        about_model(symmetries_continuous=[{"axis": [0, 0, 1], "offset": [0, 0, 1e30]}]),
        "symmetries_continuous[0]: 'offset' is 1e+27 m away, expected at most 100 m",
    ),
    "discrete symmetry out of reach": (
        about_model(symmetries_discrete=[[1, 0, 0, 1e30, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]]),
        "symmetries_discrete[0] is 1e+27 m away, expected at most 100 m",
    ),
    "symmetry mirrors": (
        about_model(symmetries_discrete=[np.diag([-1, 1, 1, 1]).ravel().tolist()]),
        "object 5: symmetries_discrete[0] is not rigid",
    ),
    "symmetry of 15 numbers": (about_model(symmetries_discrete=[[1.0] * 15]), "holds 15 numbers, expected 16"),
    "symmetry without axis": (about_model(symmetries_continuous=[{}]), "symmetries_continuous[0] has no 'axis'"),
}
NOTED: dict[str, tuple[Spoil, str]] = {
    "pose with NaN": (truth(cam_t_m2c=[float("nan"), 0, 1]), "obj_000005 (#1) has no ground truth: "),
    "pose no rotation": (
        truth(cam_R_m2c=[1, 0, 0, 0, 1, 0, 0, 0, -1]),
        "the pose is not rigid: det(R) = -1.000",
    ),
    "pose out of reach": (
        truth(cam_t_m2c=[0, 0, 1e30]),
        "entry 1: 'cam_t_m2c' is 1e+27 m away, expected at most 100 m; is it in millimetres?",
    ),
    "pose incomplete": (
        edited("scene_gt.json", lambda c: c["3"][1].pop("cam_R_m2c")),
        "entry 1 has no 'cam_R_m2c'",
    ),
    "mask of one pixel": (
        lambda m: image(m, "mask_visib/000003_000001.png", np.eye(1, 4800, 2000, dtype=np.uint8).reshape(60, 80)),
        "obj_000005 (#1): its mask covers 1 px, too few to find a pose; expected at least 10",
    ),
    "no depth in one mask": (
        lambda m: image(
            m,
            "depth/000003.png",
            np.where(m.problem.instances[1].mask, 0, m.problem.observation.depth_m * 1e4).astype(np.uint16),
        ),
        "obj_000005 (#1) has no depth inside its mask",
    ),
}


@pytest.mark.parametrize(
    ("cases", "left"), [(MASK_TROUBLE, [0, 2]), (MODEL_TROUBLE, [0, 2]), (NOTED, [0, 1, 2])],
    ids=["mask", "model", "noted"],
)  # fmt: skip
def test_trouble_with_an_instance_is_a_note_and_the_others_go_on(
    tmp_path: Path, cases: dict[str, tuple[Spoil, str]], left: list[int]
) -> None:
    for case, (spoil, words) in cases.items():
        made = make(tmp_path / case)
        spoil(made)
        problem = made.read()
        assert [i.instance_id for i in problem.instances] == left, case
        assert any(words in note for note in problem.notes), (case, problem.notes)
        assert all("\n" not in note for note in problem.notes)


WRONG_SETTINGS: tuple[tuple[dict[str, Any], str], ...] = (
    ({"split": "val"}, "unknown split 'val'; available: test"),
    ({"split": "../test"}, "unknown split '../test'; did you mean 'test'? available: test"),
    ({"frames": ("50",)}, 'frame \'50\' is not "scene/image", such as "50/1"'),
    ({"frames": ("7/-3",)}, 'is not "scene/image"'),
    ({"frames": ("9" * 5000 + "/3",)}, 'is not "scene/image"'),
    ({"frames": ("7/3/1",)}, 'is not "scene/image"'),
    ({"frames": ("50/1",)}, "unknown scene 50; available: 7"),
    ({"frames": ("7/9",)}, "unknown image 9 in scene 7 of boxes/test; available: 3"),
    ({"objects": (9,)}, "unknown object 9 in scene.objects; available: 2 (obj_000002), 5 (obj_000005)"),
    ({"masks": "mask_pred"}, "scene.masks is 'mask_pred', expected mask_visib, mask, or the path"),
    ({"masks": "/nowhere/det.json"}, "/nowhere/det.json does not exist"),
)


def test_wrong_settings_are_one_clear_line(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes")
    for scene, words in WRONG_SETTINGS:
        assert words in refusal(made, **scene)


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
