"""BOP folders with all their traps are read as what went into them; what is written as one is read back as it was."""

from __future__ import annotations

import gzip
import json
import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.fakes import box_problem
from tests.scenes.bop_folder import OBJ_IDS, POSE, Made, box_ply, detections, make, refusal
from tests.scenes.write_bop import write_bop
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.evaluation.ground_truth import find_targets, read_targets
from verefine_viz.evaluation.results_scores import evaluate_files
from verefine_viz.run.data_folder import data_at, holds_frames, open_session
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.source import SceneSource, open_scene


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
def test_images_and_models_of_any_kind(tmp_path: Path, color: str, suffix: str, models: str) -> None:
    made = make(tmp_path, color=color, suffix=suffix, models=models)
    depth_m = made.problem.observation.depth_m
    (made.scene / "depth" / "000003.png").unlink()
    Image.fromarray((depth_m * 1e4).astype(np.float32)).save(made.scene / "depth" / "000003.tif")
    observation = made.read().observation
    np.testing.assert_allclose(observation.depth_m, depth_m, rtol=1e-6)
    assert observation.rgb.shape == (60, 80, 3)
    assert np.abs(observation.rgb.astype(int) - 128).max() <= 1


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


def test_world_gravity_needs_the_cameras_rotation(made: Made) -> None:
    assert BopDataset(made.root, "test").image(7, 3).R_world_cam is None
    observation = made.read(gravity="world").observation
    assert observation.support is None
    assert "cam_R_w2c" in observation.support_note


def test_targets_choose_the_frames_of_their_split(tmp_path: Path) -> None:
    made = make(tmp_path / "test")
    more = {"scene_id": 99, "im_id": 1, "obj_id": 2, "inst_count": 1}
    made.edit("../../test_targets_bop19.json", lambda c: c.append(more))
    source = made.open()
    assert source.frames == ("7/3",)
    assert "1 of 2 " in source.notes[0]
    made = make(tmp_path / "train", split="train_real")
    made.edit("../../test_targets_bop19.json", lambda c: c.clear())
    assert made.open(split="train_real").frames == ("7/3",)


def test_named_frames_keep_their_order_and_occur_once_with_a_note(made: Made) -> None:
    made.edit("scene_camera.json", lambda c: c.update({"10": c["3"]}))
    source = made.open(frames=("7/10", "7/3", "007/000010"))
    assert source.frames == ("7/10", "7/3")
    assert [note for note in source.notes if "7/10" in note] == [*source.notes]


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


def test_a_mesh_in_metres_is_recognised_and_one_of_another_size_noted(made: Made, tmp_path: Path) -> None:
    path = tmp_path / "models" / "obj_000005.ply"
    in_mm = path.read_text()
    path.write_text(box_ply(made.problem, unit_m=1.0))
    problem = made.read()
    np.testing.assert_allclose(problem.models[5].vertices, made.problem.models[1].vertices, atol=1e-9)
    (note,) = problem.notes
    assert "metres" in note
    path.write_text(in_mm)
    made.edit("../../models/models_info.json", lambda c: c["5"].update(diameter=300.0))
    (note,) = made.read().notes
    assert "141.4 mm" in note
    assert "300 mm" in note


def test_missing_scene_gt_points_to_detections(made: Made, tmp_path: Path) -> None:
    (made.scene / "scene_gt.json").unlink()
    (tmp_path / "detections_x-test.json").write_text(json.dumps(detections(made)))
    with pytest.raises(InputError, match=r"scene_gt.*detections_x-test\.json"):
        made.read()
    problem = made.read(masks=str(tmp_path / "detections_x-test.json"))
    assert [i.obj_id for i in problem.instances] == list(OBJ_IDS)
    assert all(i.T_cam_obj_gt is None and i.hypotheses == () for i in problem.instances)


def test_packed_detections_in_any_order_get_their_own_ground_truth(made: Made, tmp_path: Path) -> None:
    entries = detections(made, "string")
    for entry, score in zip(entries, (0.1, 0.2, 0.3), strict=True):
        entry["score"] = score
    (tmp_path / "det.json.gz").write_bytes(gzip.compress(json.dumps(entries).encode()))
    problem = made.read(masks=str(tmp_path / "det.json.gz"))
    for got, k in zip(problem.instances, (2, 1, 0), strict=True):
        np.testing.assert_array_equal(got.mask, made.problem.instances[k].mask)
        np.testing.assert_allclose(got.T_cam_obj_gt, made.problem.instances[k].T_cam_obj_gt, atol=1e-12)


def test_detections_without_a_mask_and_more_than_there_are_objects_are_left_out(made: Made, tmp_path: Path) -> None:
    entries = detections(made)
    stray = {**entries[1], "score": 0.05}
    (tmp_path / "more.json").write_text(json.dumps([stray, *entries]))
    problem = made.read(masks=str(tmp_path / "more.json"))
    assert [i.obj_id for i in problem.instances] == list(OBJ_IDS)
    assert any("1 detections of objects" in note for note in problem.notes)
    entries[1]["segmentation"] = {}
    del entries[2]["segmentation"]
    (tmp_path / "boxes.json").write_text(json.dumps(entries))
    problem = made.read(masks=str(tmp_path / "boxes.json"))
    assert [i.obj_id for i in problem.instances] == [2]
    assert any("2 detections in boxes.json" in note for note in problem.notes)


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


FILES = ("scene_camera", "scene_gt", "scene_gt_info")
KINDS = ("rgb", "depth", "mask", "mask_visib")


def opened(folder: Path, **scene: object) -> SceneSource:
    session = open_session(folder, {"scene": {"model_points": 200, **scene}})
    return open_scene(session.scene, session.hypotheses)


def with_sensors(made: Made, *sensors: str, grey: str = "") -> Made:
    """The same images by several sensors, the second twice as near: its depth and its camera are other ones."""
    for k, sensor in enumerate(sensors):
        for name in FILES:
            shutil.copy(made.scene / f"{name}.json", made.scene / f"{name}_{sensor}.json")
        for kind in KINDS:
            named = "gray" if kind == "rgb" and sensor == grey else kind
            shutil.copytree(made.scene / kind, made.scene / f"{named}_{sensor}")
        made.edit(f"scene_camera_{sensor}.json", lambda c, k=k: c["3"].update(depth_scale=0.1 / (k + 1)))
    for name in FILES:
        (made.scene / f"{name}.json").unlink()
    for kind in (*KINDS, "gray"):
        shutil.rmtree(made.scene / kind)
    return made


def masks_to_coco(made: Made, encoding: str, order: tuple[int, ...] = (0, 1, 2)) -> None:
    """Moves the visible masks of some instances into scene_gt_coco.json; ids there count from 1."""
    entries = detections(made, encoding)
    annotations = []
    for number, k in enumerate(order):
        v, u = np.nonzero(made.problem.instances[k].mask)
        box = [int(u.min()), int(v.min()), int(np.ptp(u)) + 1, int(np.ptp(v)) + 1]
        entry = {"id": number + 1, "image_id": 3, "category_id": OBJ_IDS[k], "iscrowd": 0, "bbox": box}
        annotations.append({**entry, "segmentation": entries[k]["segmentation"]})
    (made.scene / "scene_gt_coco.json").write_text(json.dumps({"images": [], "annotations": annotations}))
    for kind in ("mask", "mask_visib"):
        shutil.rmtree(made.scene / kind)


def masks_are(problem: Problem, made: Made, *gt_ids: int) -> bool:
    """Whether these instances, and no others, have the masks that went into the folder."""
    return [i.instance_id for i in problem.instances] == [*gt_ids] and all(
        np.array_equal(i.mask, made.problem.instances[i.instance_id].mask) for i in problem.instances
    )


def test_a_sensor_is_chosen_by_its_name(tmp_path: Path) -> None:
    made = with_sensors(make(tmp_path), "cam1", "photoneo", grey="photoneo")
    assert holds_frames(tmp_path)
    plain, median_m = made.problem, float(np.median(made.problem.observation.depth_m))
    for given, read in (("", "cam1"), ("cam1", "cam1"), ("photoneo", "photoneo")):
        source = opened(tmp_path, sensor=given)
        problem = source.problem(made.frame)
        assert problem.title == f"{tmp_path.name} test {read}"
        factor = {"cam1": 1.0, "photoneo": 0.5}[read]
        assert np.median(problem.observation.depth_m) == pytest.approx(factor * median_m, rel=1e-3)
        assert problem.observation.rgb is not None
        assert masks_are(problem, made, *range(len(plain.instances)))
        assert all(i.T_cam_obj_gt is not None and i.visib_fract is not None for i in problem.instances)
        # Which one was taken is named only where it was left open.
        assert any("cam1" in note and "photoneo" in note for note in source.notes) == (not given)
    assert "cam1, photoneo" in refusal(made, sensor="cam9")
    assert "cam1" in refusal(make(tmp_path / "plain"), sensor="cam1")


def test_the_sensor_with_ground_truth_and_depth_is_preferred(tmp_path: Path) -> None:
    made = with_sensors(make(tmp_path), "a", "b", "c")
    (made.scene / "scene_gt_a.json").unlink()
    shutil.rmtree(made.scene / "depth_b")
    assert made.read().title.endswith(" c")


@pytest.mark.parametrize("encoding", ["list", "string"])
def test_masks_come_from_coco_annotations(made: Made, tmp_path: Path, encoding: str) -> None:
    masks_to_coco(made, encoding)
    source = opened(tmp_path)
    assert any("scene_gt_coco.json" in note for note in source.notes)
    assert masks_are(source.problem(made.frame), made, 0, 1, 2)
    assert "mask" in refusal(made, masks="mask")  # The full silhouettes are not in it.


def test_instances_without_visible_pixels_shift_no_mask(made: Made) -> None:
    made.edit("scene_gt_info.json", lambda c: c["3"][0].update(visib_fract=0))
    masks_to_coco(made, "string", (1, 2))
    for k in range(2):
        made.edit("scene_gt_coco.json", lambda c, k=k: c["annotations"][k].update(bbox=None))
    assert masks_are(made.read(), made, 1, 2)


@pytest.mark.parametrize("order", [(1, 0), (0, 2, 1), (2,)])
def test_without_visible_shares_masks_go_to_the_poses_in_their_boxes(made: Made, order: tuple[int, ...]) -> None:
    (made.scene / "scene_gt_info.json").unlink()
    masks_to_coco(made, "list", order)
    assert masks_are(made.read(), made, *sorted(order))


def test_a_mask_of_coco_that_is_missing_or_damaged_leaves_its_instance_out(made: Made) -> None:
    masks_to_coco(made, "list")
    for changed, words in (
        ({"segmentation": {"size": [60, 80], "counts": [9]}}, "annotation 1: 'segmentation'"),
        ({"category_id": "mug"}, "annotation of entry 1: Expected `int`"),
    ):
        made.edit("scene_gt_coco.json", lambda c, changed=changed: c["annotations"][1].update(changed))
        problem = made.read()
        assert masks_are(problem, made, 0, 2)
        assert [left.instance_id for left in problem.left_out] == [1]
        assert any(words in note for note in problem.notes), problem.notes
    made.edit("scene_gt_coco.json", lambda c: c.update(annotations=[]))
    assert "entry 0 of image 3" in refusal(made)


def test_the_split_with_ground_truth_opens_and_the_others_are_named(made: Made, tmp_path: Path) -> None:
    order = ["test", "train_pbr", "val", "onboarding"]
    for split in order[1:]:
        shutil.copytree(made.scene.parent, tmp_path / split)
    for split in order:
        lines: list[str] = []
        assert open_session(tmp_path, {}, lines.append).scene.split == split
        (said,) = lines
        assert all(other in said for other in order)
        (tmp_path / split / "000007" / "scene_gt.json").unlink()
    session = open_session(tmp_path, {})
    assert (session.scene.split, session.hypotheses.source) == ("test", "ppf")
    assert open_session(tmp_path, {"scene": {"split": "val"}}).scene.split == "val"


def test_a_split_or_a_scene_opens_from_its_data_set(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes", targets=False)
    made.edit("scene_camera.json", lambda c: c.update({"4": c["3"]}))
    shutil.copytree(made.scene, made.scene.with_name("000012"))
    shutil.copytree(made.root / "test", made.root / "val")
    (tmp_path / "link").symlink_to(made.scene)
    every, of_scene = ("7/3", "7/4", "12/3", "12/4"), ("7/3", "7/4")
    for folder, frames in ((made.scene.parent, every), (made.scene, of_scene), (tmp_path / "link", of_scene)):
        source = opened(folder)
        assert source.frames == frames
        assert masks_are(source.problem("7/3"), made, 0, 1, 2)
    scene = data_at(made.root / "val" / "000012", {}).session.scene
    assert (scene.split, scene.frames) == ("val", ("12/3", "12/4"))
    assert opened(made.scene, frames=("12/3",)).frames == ("12/3",)
    with pytest.raises(VerefineError, match=f"did you mean {made.root}?"):
        opened(tmp_path)


@pytest.mark.parametrize("years", [(18, 19), (19, 24), (18, 24)])
def test_of_several_targets_files_all_take_the_same(tmp_path: Path, years: tuple[int, ...]) -> None:
    """``view``, ``batch``, ``datasets check`` and ``evaluate``; of BOP'19 where it is there, else the newest."""
    made = make(tmp_path, targets=False)
    made.edit("scene_camera.json", lambda c: c.update({str(year): c["3"] for year in years}))
    for year in years:
        target = {"scene_id": 7, "im_id": year}
        more = {} if year == 24 else {"obj_id": 5, "inst_count": 1}
        (tmp_path / f"test_targets_bop{year}.json").write_text(json.dumps([{**target, **more}]))
    year = 19 if 19 in years else max(years)
    assert opened(tmp_path).frames == opened(made.scene).frames == (f"7/{year}",)
    asked = read_targets(find_targets(tmp_path, "test"))
    assert asked.name == f"test_targets_bop{year}.json"
    assert asked.counts == BopDataset(tmp_path, "test").targets


def assert_same(got: Problem, want: Problem, depth_scale_mm: float) -> None:
    assert got.frame == want.frame
    a, b = got.observation, want.observation
    np.testing.assert_allclose(a.depth_m, b.depth_m, atol=depth_scale_mm * 0.5e-3 + 1e-6)
    np.testing.assert_allclose(a.camera.K, b.camera.K, atol=0)
    np.testing.assert_array_equal(a.object_mask, b.object_mask)
    if b.rgb is None:
        assert a.rgb is None
    else:
        np.testing.assert_array_equal(a.rgb, b.rgb)
    assert [(i.obj_id, i.visib_fract) for i in got.instances] == [(i.obj_id, i.visib_fract) for i in want.instances]
    for i, j in zip(got.instances, want.instances, strict=True):
        np.testing.assert_array_equal(i.mask, j.mask)
        np.testing.assert_allclose(i.T_cam_obj_gt, j.T_cam_obj_gt, atol=1e-14)
    assert got.models.keys() == want.models.keys()
    for obj_id, model in want.models.items():
        back = got.models[obj_id]
        assert back.name == model.name
        assert back.diameter_m == pytest.approx(model.diameter_m, rel=1e-12)
        np.testing.assert_allclose(back.vertices, model.vertices, rtol=1e-14, atol=1e-17)
        np.testing.assert_array_equal(back.faces, model.faces)
        np.testing.assert_allclose(back.symmetries, model.symmetries, atol=1e-12)
        np.testing.assert_array_equal(back.vertex_colors, model.vertex_colors)


@pytest.mark.parametrize("depth_scale_mm", [0.1, 1.0])
def test_write_then_read_is_identity(tmp_path: Path, depth_scale_mm: float) -> None:
    turns = np.stack([transform(axis_angle([0, 0, 1], k * np.pi), [0.001 * k, 0, 0]) for k in range(2)])
    colors = np.arange(24, dtype=np.uint8).reshape(8, 3)
    first, second = box_problem(n_instances=2), replace(box_problem(n_instances=3, seed=1), scene_id=4, im_id=17)
    model = replace(first.models[1], symmetries=turns, vertex_colors=colors, name="a mug & more")
    first, second = (replace(problem, models={1: model}) for problem in (first, second))
    second = replace(second, observation=replace(second.observation, rgb=None))
    write_bop(tmp_path, [first, second], split="train_made", depth_scale_mm=depth_scale_mm)
    settings = SceneSettings(source="bop", dataset=str(tmp_path), split="train_made", gravity="world")
    source = open_scene(settings, HypothesesSettings())
    assert source.frames == ("0/1", "4/17")
    for problem in (first, second):
        got, want = source.problem(problem.frame), problem.observation.support.T_world_cam
        assert_same(got, problem, depth_scale_mm)
        assert len(got.notes) == (problem.observation.rgb is None)
        np.testing.assert_allclose(got.observation.support.T_world_cam[2, :3], want[2, :3], atol=1e-9)
    entry = json.loads((tmp_path / "train_made" / "000004" / "scene_camera.json").read_text())["17"]
    T_cam_world = transform(np.reshape(entry["cam_R_w2c"], (3, 3)), np.array(entry["cam_t_w2c"]) * 1e-3)
    np.testing.assert_allclose(inverse(T_cam_world), second.observation.support.T_world_cam, atol=1e-12)
