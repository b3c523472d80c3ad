"""BOP folders with all their traps are read as what went into them."""

from __future__ import annotations

import gzip
import json
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.scenes.bop_folder import OBJ_IDS, Made, box_ply, detections, make
from verefine_viz.core.errors import InputError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.scenes.bop import BopDataset


def test_a_plain_folder_gives_back_what_went_into_it(made: Made, tmp_path: Path) -> None:
    problem, truth = made.read(), made.problem
    assert problem.frame == "7/3"
    assert problem.title == f"{tmp_path.name} test"
    assert [i.obj_id for i in problem.instances] == list(OBJ_IDS)
    assert [i.instance_id for i in problem.instances] == [0, 1, 2]
    assert [i.visib_fract for i in problem.instances] == [0.5, 0.6, 0.7]
    np.testing.assert_allclose(problem.observation.depth_m, truth.observation.depth_m, atol=0.5e-4 + 1e-7)
    np.testing.assert_array_equal(problem.observation.rgb, truth.observation.rgb)
    np.testing.assert_array_equal(problem.observation.object_mask, truth.observation.object_mask)
    for got, want in zip(problem.instances, truth.instances, strict=True):
        np.testing.assert_allclose(got.T_cam_obj_gt, want.T_cam_obj_gt, atol=1e-12)
        np.testing.assert_array_equal(got.mask, want.mask)
        assert len(got.hypotheses) == 5
    for model in problem.models.values():
        np.testing.assert_allclose(model.vertices, truth.models[1].vertices, atol=1e-9)
    assert (problem.notes, problem.left_out) == ((), ())


@pytest.mark.parametrize(
    ("color", "suffix", "models"),
    [("gray", ".tif", "models_eval"), ("rgb", ".jpg", "models_cad"), ("gray16", ".png", "models")],
)
def test_colour_and_grey_images_of_any_format_and_any_folder_of_models(
    tmp_path: Path, color: str, suffix: str, models: str
) -> None:
    rgb = make(tmp_path, color=color, suffix=suffix, models=models).read().observation.rgb
    assert rgb.shape == (60, 80, 3)
    assert np.abs(rgb.astype(int) - 128).max() <= 1


def test_float_depth_images_are_read(made: Made) -> None:
    want = made.problem.observation.depth_m
    (made.scene / "depth" / "000003.png").unlink()
    Image.fromarray((want * 1e4).astype(np.float32)).save(made.scene / "depth" / "000003.tif")
    np.testing.assert_allclose(made.read().observation.depth_m, want, rtol=1e-6)


def test_the_photo_is_there_before_anything_is_prepared(tmp_path: Path) -> None:
    made, events = make(tmp_path), list[object]()
    progress = ProgressToken(preparing=lambda: nullcontext(events.append("prepared")), seen=events.append)
    made.open().problem(made.frame, progress)
    np.testing.assert_array_equal(events[0], made.problem.observation.rgb)
    assert events[1] == "prepared"


def test_each_image_has_its_own_camera(made: Made) -> None:
    for kind in ("depth", "rgb"):
        Image.open(made.scene / kind / "000003.png").save(made.scene / kind / "000012.png")
    for k in range(3):
        Image.open(made.scene / "mask_visib" / f"000003_{k:06d}.png").save(
            made.scene / "mask_visib" / f"000012_{k:06d}.png"
        )
    made.edit(
        "scene_camera.json", lambda c: c.update({"12": {"cam_K": [99, 0, 40, 0, 98, 30, 0, 0, 1], "depth_scale": 0.2}})
    )
    made.edit("scene_gt.json", lambda c: c.update({"12": c["3"]}))
    source = made.open(frames=("7/3", "7/12"))
    first, second = source.problem("7/3").observation, source.problem("7/12").observation
    assert (first.camera.fx, second.camera.fx, second.camera.fy) == (80, 99, 98)
    np.testing.assert_allclose(second.depth_m, 2 * first.depth_m, rtol=1e-6)


def test_world_gravity_of_a_scene_that_never_knows_it_is_refused(made: Made) -> None:
    assert BopDataset(made.root, "test").image(7, 3).R_world_cam is None
    observation = made.read(gravity="world").observation
    assert observation.support is None
    assert 'gravity = "world" needs the camera\'s rotation (cam_R_w2c)' in observation.support_note


def test_targets_that_are_not_on_the_disk_are_left_out_with_a_note(made: Made) -> None:
    more = {"scene_id": 99, "im_id": 1, "obj_id": 2, "inst_count": 1}
    made.edit("../../test_targets_bop19.json", lambda c: c.append(more))
    source = made.open()
    assert source.frames == ("7/3",)
    assert "1 of 2 frames" in source.notes[0]


def test_targets_of_the_test_split_do_not_bind_another_split(tmp_path: Path) -> None:
    made = make(tmp_path, split="train_real")
    made.edit("../../test_targets_bop19.json", lambda c: c.clear())
    assert made.open(split="train_real").frames == ("7/3",)


def test_named_frames_keep_their_order_and_occur_once_with_a_note(made: Made) -> None:
    made.edit("scene_camera.json", lambda c: c.update({"10": c["3"]}))
    source = made.open(frames=("7/10", "7/3", "007/000010"))
    assert source.frames == ("7/10", "7/3")
    assert source.notes == ("scene.frames names frame 7/10 more than once; it counts once",)


def test_all_frames_means_frames_that_hold_a_selected_object(tmp_path: Path) -> None:
    made = make(tmp_path, targets=False)
    made.edit("scene_camera.json", lambda c: c.update({"4": c["3"]}))
    made.edit("scene_gt.json", lambda c: c.update({"4": [e for e in c["3"] if e["obj_id"] == 2]}))
    source = made.open(objects=(5,))
    assert source.frames == ("7/3",)
    problem = source.problem("7/3")
    assert ([i.instance_id for i in problem.instances], {*problem.models}) == ([1], {5})
    np.testing.assert_array_equal(problem.observation.object_mask, made.problem.observation.object_mask)
    assert made.open(objects=(2,)).frames == ("7/3", "7/4")


def test_either_mask_folder_can_be_used(made: Made) -> None:
    Image.fromarray(np.full((60, 80), 255, np.uint8)).save(made.scene / "mask" / "000003_000001.png")
    assert made.read(masks="mask").instances[1].mask.all()
    assert not made.read(masks="mask_visib").instances[1].mask.all()


def test_names_come_from_a_file_in_either_direction(made: Made, tmp_path: Path) -> None:
    assert made.read().models[5].name == "obj_000005"
    (tmp_path / "models" / "obj_names.json").write_text('{"5": "mug"}')
    assert made.read().models[5].name == "mug"
    (tmp_path / "models" / "obj_names.json").write_text('{"cup": 5}')
    assert made.read().models[5].name == "cup"


def test_a_metre_mesh_is_recognised_and_said(made: Made, tmp_path: Path) -> None:
    (tmp_path / "models" / "obj_000005.ply").write_text(box_ply(made.problem, unit_m=1.0))
    problem = made.read()
    np.testing.assert_allclose(problem.models[5].vertices, made.problem.models[1].vertices, atol=1e-9)
    assert len(problem.notes) == 1
    assert "its unit was taken to be metres" in problem.notes[0]


def test_a_mesh_of_another_size_is_said(made: Made) -> None:
    made.edit("../../models/models_info.json", lambda c: c["5"].update(diameter=300.0))
    notes = made.read().notes
    assert len(notes) == 1
    assert "141.4 mm across, models_info.json says 300 mm; one of them is wrong" in notes[0]


def test_missing_scene_gt_points_to_detections(made: Made, tmp_path: Path) -> None:
    (made.scene / "scene_gt.json").unlink()
    (tmp_path / "detections_x-test.json").write_text(json.dumps(detections(made)))
    with pytest.raises(InputError, match=r"no scene_gt.*detections_x-test\.json"):
        made.read()
    problem = made.read(masks=str(tmp_path / "detections_x-test.json"))
    assert [i.obj_id for i in problem.instances] == list(OBJ_IDS)
    assert all(i.T_cam_obj_gt is None and i.hypotheses == () for i in problem.instances)
    assert sum("no ground truth to disturb" in note for note in problem.notes) == 3


def test_packed_detections_in_any_order_get_their_own_ground_truth(made: Made, tmp_path: Path) -> None:
    entries = detections(made, "string")
    for entry, score in zip(entries, (0.1, 0.2, 0.3), strict=True):
        entry["score"] = score
    (tmp_path / "det.json.gz").write_bytes(gzip.compress(json.dumps(entries).encode()))
    problem = made.read(masks=str(tmp_path / "det.json.gz"))
    for got, k in zip(problem.instances, (2, 1, 0), strict=True):
        np.testing.assert_array_equal(got.mask, made.problem.instances[k].mask)
        np.testing.assert_allclose(got.T_cam_obj_gt, made.problem.instances[k].T_cam_obj_gt, atol=1e-12)


def test_box_only_detections_are_left_out_with_a_note(made: Made, tmp_path: Path) -> None:
    entries = detections(made)
    entries[1]["segmentation"] = {}
    del entries[2]["segmentation"]
    (tmp_path / "det.json").write_text(json.dumps(entries))
    problem = made.read(masks=str(tmp_path / "det.json"))
    assert [i.obj_id for i in problem.instances] == [2]
    assert any("2 detections in det.json have a box but no mask" in note for note in problem.notes)
    assert any("obj_000005 is in the ground truth but was not detected" in note for note in problem.notes)


def test_only_as_many_detections_as_objects_are_kept(made: Made, tmp_path: Path) -> None:
    entries = detections(made)
    stray = {**entries[1], "score": 0.05}
    (tmp_path / "det.json").write_text(json.dumps([stray, *entries]))
    problem = made.read(masks=str(tmp_path / "det.json"))
    assert [i.obj_id for i in problem.instances] == list(OBJ_IDS)
    assert any("1 detections of objects" in note for note in problem.notes)
