"""BOP folders as they really are: several sensors, masks in scene_gt_coco.json, several splits, names nearly right."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.scenes.bop_folder import OBJ_IDS, Made, detections, make, refusal
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.evaluation.ground_truth import find_targets, read_targets
from verefine_viz.run.data_folder import data_at, holds_frames, open_session
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.source import SceneSource, open_scene

FILES = ("scene_camera", "scene_gt", "scene_gt_info")
KINDS = ("rgb", "depth", "mask", "mask_visib")


def opened(folder: Path, **scene: object) -> SceneSource:
    session = open_session(folder, {"scene": {"model_points": 200, **scene}})
    return open_scene(session.scene, session.hypotheses)


def refused(folder: Path, **scene: object) -> str:
    with pytest.raises(VerefineError) as caught:
        source = opened(folder, **scene)
        source.problem(source.frames[0])
    assert "\n" not in str(caught.value)
    return str(caught.value)


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
        assert [note for note in source.notes if "cam1 is read" in note and "photoneo" in note] == [
            note for note in source.notes if not given
        ]


def test_a_sensor_that_is_not_there_lists_those_that_are(tmp_path: Path) -> None:
    made = with_sensors(make(tmp_path / "a"), "cam1", "cam2")
    assert "unknown sensor 'cam9'; available: cam1, cam2 in" in refused(made.root, sensor="cam9")
    assert "has no sensor 'cam1'" in refusal(make(tmp_path / "b"), sensor="cam1")


def test_the_sensor_with_ground_truth_and_depth_is_preferred(tmp_path: Path) -> None:
    made = with_sensors(make(tmp_path), "a", "b", "c")
    (made.scene / "scene_gt_a.json").unlink()
    shutil.rmtree(made.scene / "depth_b")
    assert made.read().title.endswith(" c")


@pytest.mark.parametrize("encoding", ["list", "string"])
def test_masks_come_from_coco_annotations(made: Made, tmp_path: Path, encoding: str) -> None:
    masks_to_coco(made, encoding)
    source = opened(tmp_path)
    assert any("masks come from scene_gt_coco.json" in note for note in source.notes)
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


def test_a_mask_that_is_missing_or_damaged_leaves_its_instance_out(made: Made) -> None:
    masks_to_coco(made, "list")
    made.edit(
        "scene_gt_coco.json", lambda c: c["annotations"][1].update(segmentation={"size": [60, 80], "counts": [9]})
    )
    problem = made.read()
    assert masks_are(problem, made, 0, 2)
    assert [left.instance_id for left in problem.left_out] == [1]
    assert any("annotation 1: 'segmentation': the run lengths are damaged" in note for note in problem.notes)
    made.edit("scene_gt_coco.json", lambda c: c["annotations"][1].update(category_id="mug"))
    assert masks_are(problem := made.read(), made, 0, 2)
    assert any("annotation of entry 1: Expected `int`, got `str`" in note for note in problem.notes), problem.notes
    made.edit("scene_gt_coco.json", lambda c: c.update(annotations=[]))
    assert "scene_gt_coco.json has no mask of entry 0 of image 3" in refusal(made)


def test_the_split_with_ground_truth_opens_and_the_others_are_named(made: Made, tmp_path: Path) -> None:
    for split in ("val", "train_pbr", "onboarding"):
        shutil.copytree(tmp_path / "test", tmp_path / split)
    order = ["test", "train_pbr", "val", "onboarding"]
    for split in order:
        lines: list[str] = []
        assert open_session(tmp_path, {}, lines.append).scene.split == split
        (said,) = lines
        assert f"split {split} (also: " in said
        assert all(other in said for other in order)
        (tmp_path / split / "000007" / "scene_gt.json").unlink()
    session = open_session(tmp_path, {})
    assert (session.scene.split, session.hypotheses.source) == ("test", "ppf")
    assert open_session(tmp_path, {"scene": {"split": "val"}}).scene.split == "val"
    assert made.root == tmp_path


def test_a_split_or_a_scene_opens_from_its_data_set(tmp_path: Path) -> None:
    made = make(tmp_path / "boxes", targets=False)
    made.edit("scene_camera.json", lambda c: c.update({"4": c["3"]}))
    shutil.copytree(made.scene, made.scene.with_name("000012"))
    shutil.copytree(tmp_path / "boxes" / "test", tmp_path / "boxes" / "val")
    (tmp_path / "link").symlink_to(made.scene)
    every, of_scene = ("7/3", "7/4", "12/3", "12/4"), ("7/3", "7/4")
    for folder, frames in ((made.scene.parent, every), (made.scene, of_scene), (tmp_path / "link", of_scene)):
        source = opened(folder)
        assert source.frames == frames
        assert masks_are(source.problem("7/3"), made, 0, 1, 2)
    known = data_at(tmp_path / "boxes" / "val" / "000012", {})
    assert (known.session.scene.split, known.session.scene.frames) == ("val", ("12/3", "12/4"))
    assert known.what == f"scene 12 of split val of the data set {made.root}"
    assert opened(made.scene, frames=("12/3",)).frames == ("12/3",)
    assert f"did you mean {made.root}?" in refused(tmp_path)


def renamed(old: str, new: str) -> Callable[[Made], object]:
    return lambda made: (made.scene / old).rename(made.scene / new)


NEAR: tuple[tuple[Callable[[Made], object], str], ...] = (
    (renamed("depth/000003.png", "depth/000003.raw"), "in depth/ there is 000003.raw"),
    (renamed("depth/000003.png", "depth/frame_3.png"), "in depth/ there is frame_3.png"),
    (renamed("depth", "Depth"), "in 000007/ there is Depth"),
    (renamed("mask_visib", "masks_visib"), "there is masks_visib"),
    (renamed("../../models", "../../model"), "there is model"),
    (renamed("scene_camera.json", "scene_camera.json.gz"), "there is scene_camera.json.gz"),
    (renamed("scene_gt.json", "scene_gts.json"), "there is scene_gts.json"),
)


def test_what_lies_beside_a_missing_file_is_named(tmp_path: Path) -> None:
    for k, (spoil, words) in enumerate(NEAR):
        made = make(tmp_path / str(k))
        spoil(made)
        assert words in refusal(made)
        assert words in refused(made.root)


def test_what_lies_beside_a_missing_mask_model_or_colour_is_noted(made: Made) -> None:
    renamed("rgb/000003.png", "rgb/3.png")(made)
    renamed("mask_visib/000003_000000.png", "mask_visib/3_0.png")(made)
    renamed("../../models/obj_000005.ply", "../../models/5.ply")(made)
    problem = made.read()
    assert [i.instance_id for i in problem.instances] == [2]
    for words in ("in rgb/ there is 3.png", "in mask_visib/ there is 3_0.png", "in models/ there is 5.ply"):
        assert any(words in note for note in problem.notes), (words, problem.notes)


def test_nothing_is_named_that_is_not_like_it(made: Made) -> None:
    (made.scene / "depth/000003.png").rename(made.scene / "depth/000013.png")
    assert "there is" not in refusal(made)
    (made.scene / "scene_gt.json").unlink()  # scene_gt_info.json is another file.
    assert "there is" not in refusal(made)


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
