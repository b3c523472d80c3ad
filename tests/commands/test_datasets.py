"""``verefine-viz datasets``: what it lists, what it finds wrong with a folder, and what it says offline."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import huggingface_hub
import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.batch.frames import make_frames
from tests.scenes.bop_folder import Made, detections
from tests.scenes.test_trace import K, picture, pose, write_box
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.commands.dataset_parts import Parts, runnable_parts
from verefine_viz.commands.datasets import CATALOGUE, Datasets
from verefine_viz.core.errors import UnavailableError
from verefine_viz.library.frame_to_solve import Frame
from verefine_viz.scenes.bop import BopDataset


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return make_frames(tmp_path / "boxes", 2)


def advice(made: Made) -> dict[str, str]:
    """What is to be done, by part; only parts where something is."""
    return {f.name: f.advice for f in check_split(made.root, "test").findings if f.advice}


def missing(parts: Parts) -> dict[str, str]:
    return {what.split()[0]: lacking for what, lacking in runnable_parts(parts)}


def test_every_data_set_of_the_paper_is_listed_with_a_way_to_get_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Datasets(folder=tmp_path).run([]) == 0
    said = capsys.readouterr().out
    for name in ("lm", "lmo", "ycbv", "xapc"):
        assert f"\n{name}  " in f"\n{said}"
    for known in CATALOGUE:
        for archive in known.archives:
            assert f"bop-benchmark/{known.name}/resolve/main/{archive}" in said
    assert str(tmp_path / "ycbv") in said


def test_a_good_folder_has_nothing_to_be_done(made: Made) -> None:
    assert advice(made) == {}
    found = missing(check_split(made.root, "test"))
    assert found == {"evaluate:": "", "view": "", "study:": "", "gravity": "cam_R_w2c"}
    assert Datasets("check", str(made.root)).run([]) == 0


def test_a_split_and_a_scene_are_checked_in_their_data_set(made: Made, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(made.root / "test", made.root / "val")
    for folder in (made.scene, made.scene.parent):
        assert Datasets("check", str(folder)).run([]) == 0
        said = capsys.readouterr().out
        assert str(made.root) in said
        assert f"{made.root.name} val" not in said


def test_the_sensor_that_is_checked_is_named_or_chosen(made: Made) -> None:
    for name in ("cam1", "cam2"):
        for file in ("scene_camera", "scene_gt", "scene_gt_info"):
            shutil.copy(made.scene / f"{file}.json", made.scene / f"{file}_{name}.json")
        for kind in ("rgb", "depth", "mask_visib"):
            shutil.copytree(made.scene / kind, made.scene / f"{kind}_{name}")
    (made.scene / "scene_camera.json").unlink()
    shutil.rmtree(made.scene / "depth_cam2")
    shutil.rmtree(made.scene / "mask_visib_cam1")
    findings = {f.name: f for f in check_split(made.root, "test").findings}
    assert findings["sensor"].result.index("cam1") < findings["sensor"].result.index("cam2")
    assert findings["masks"].advice
    assert not findings["depth and colour"].advice
    assert Datasets("check", str(made.root), sensor="cam2").run([]) == 1


@pytest.mark.parametrize(("without", "said"), [((0, 1), "all of them"), ((1,), "7/1")])
def test_frames_without_colour_are_a_note(made: Made, without: Sequence[int], said: str) -> None:
    for k in without:
        (made.scene / "rgb" / f"{k:06d}.png").unlink()
    (found,) = [f for f in check_split(made.root, "test").findings if f.name == "depth and colour"]
    assert said in found.result
    assert advice(made) == {}
    assert Datasets("check", str(made.root)).run([]) == 0


def test_what_is_missing_decides_what_can_be_run(made: Made) -> None:
    (made.scene / "scene_gt.json").unlink()
    for kind in ("mask", "mask_visib"):
        (made.scene / kind).rename(made.scene / f"_{kind}")
    parts = check_split(made.root, "test")
    lacking = runnable_parts(parts)
    assert [words for _, words in lacking][:3] == ["masks, scene_gt.json", "masks", "masks, scene_gt.json"]
    assert "masks" in advice(made)
    assert not {f.name: f for f in parts.findings}["plausibility"].is_checked


def test_masks_of_which_nobody_knows_the_object_cannot_be_solved(made: Made) -> None:
    (made.scene / "scene_gt.json").unlink()
    assert missing(check_split(made.root, "test"))["view"]
    assert "scene_gt.json" in advice(made)["ground truth"]
    assert Datasets("check", str(made.root)).run([]) == 1
    (made.root / "detections_boxes.json").write_text("[]")
    assert missing(check_split(made.root, "test"))["view"] == ""
    assert "ground truth" not in advice(made)


def test_a_part_of_the_frames_of_the_targets_is_a_note_and_none_of_them_a_fault(made: Made) -> None:
    def wanted(*images: int) -> None:
        entries = [{"scene_id": 7, "im_id": im_id, "obj_id": 5, "inst_count": 1} for im_id in images]
        (made.root / "test_targets_bop19.json").write_text(json.dumps(entries))

    wanted(1, 5, 6)
    found = {f.name: f.result for f in check_split(made.root, "test").findings}
    assert "7/5" in found["targets"]
    assert advice(made) == {}
    assert missing(check_split(made.root, "test"))["evaluate:"].startswith("2 of the 3 images")
    assert Datasets("check", str(made.root)).run([]) == 0
    wanted(5, 6)
    assert "7/5" in advice(made)["targets"]
    assert Datasets("check", str(made.root)).run([]) == 1


def test_without_models_the_rest_is_not_looked_at_and_not_called_missing(made: Made) -> None:
    (made.root / "models").rename(made.root / "_models")
    parts = check_split(made.root, "test")
    models, rest = parts.findings
    assert "models/obj_000001.ply" in models.advice
    assert not rest.is_checked
    for _, lacking in runnable_parts(parts):
        assert lacking.startswith("models (")
    assert Datasets("check", str(made.root)).run([]) == 1


def damaged(path: str) -> Callable[[Made], object]:
    return lambda made: (made.scene / path).write_bytes(b"")


def with_meshes_of_another_kind(made: Made) -> None:
    for mesh in (made.root / "models").glob("*.ply"):
        mesh.rename(mesh.with_suffix(".txt"))


def with_a_mask_of(n_pixels: int, visib_fract: float | None) -> Callable[[Made], None]:
    def spoil(made: Made) -> None:
        path = made.scene / "mask_visib" / "000001_000002.png"
        pixels = np.array(Image.open(path))
        pixels[tuple(at[n_pixels:] for at in np.nonzero(pixels))] = 0
        Image.fromarray(pixels).save(path)
        if visib_fract is None:
            (made.scene / "scene_gt_info.json").unlink()
        else:
            made.edit("scene_gt_info.json", lambda content: content["1"][2].update(visib_fract=visib_fract))

    return spoil


FAULTS: list[tuple[Callable[[Made], object], str, str]] = [
    (damaged("depth/000001.png"), "depth and colour", "000001.png"),
    (damaged("scene_gt.json"), "ground truth", "scene_gt.json"),
    (damaged("scene_gt_info.json"), "ground truth", "scene_gt_info.json"),
    (
        lambda made: made.edit("scene_gt.json", lambda content: content.update(a1=content.pop("1"))),
        "ground truth",
        "'a1' is no image",
    ),
    (
        lambda made: made.edit("scene_gt.json", lambda content: content["0"][0].update(obj_id=9)),
        "ground truth",
        "object 9",
    ),
    (damaged("../../models/models_info.json"), "models", "models_info.json"),
    (with_meshes_of_another_kind, "models", "obj_000001.ply"),
    (lambda made: (made.scene / "mask_visib/000001_000002.png").unlink(), "masks", "000001_000002.png"),
    (damaged("mask/000000_000000.png"), "masks", "000000_000000.png"),
    (with_a_mask_of(0, None), "masks", "0 px"),
    (with_a_mask_of(9, 0.6), "masks", "9 px"),
    (
        lambda made: [shutil.copytree(made.scene, made.scene.with_name(name)) for name in ("8", "0008")],
        "scene 8",
        "are both scene 8",
    ),
]


@pytest.mark.parametrize(("spoil", "part", "words"), FAULTS, ids=[words for _, _, words in FAULTS])
def test_a_fault_is_a_finding_of_its_part_and_of_no_other(
    made: Made, spoil: Callable[[Made], object], part: str, words: str
) -> None:
    spoil(made)
    found = advice(made)
    assert found.keys() == {part}
    assert words in found[part]
    assert Datasets("check", str(made.root)).run([]) == 1


@pytest.mark.parametrize("spoil", [with_a_mask_of(0, 0.0), with_a_mask_of(10, 0.6)])
def test_small_masks_of_hidden_objects_and_those_that_suffice_are_no_fault(made: Made, spoil: Any) -> None:
    spoil(made)
    assert advice(made) == {}


def test_masks_of_a_detections_file_are_enough_to_ask_whether_the_data_fit(made: Made) -> None:
    plausible = {f.name: f for f in check_split(made.root, "test").findings}["plausibility"]
    entries = [
        {**entry, "image_id": image}
        for image in BopDataset(made.root, "test").image_ids(7)
        for entry in detections(made)
    ]
    (made.root / "detections.json").write_text(json.dumps(entries))
    for kind in ("mask", "mask_visib"):
        shutil.rmtree(made.scene / kind)
    assert {f.name: f for f in check_split(made.root, "test").findings}["plausibility"] == plausible
    for path in (made.root / "models").glob("*.ply"):
        mesh = trimesh.load(path)
        mesh.apply_scale(10)
        mesh.export(path)
    made.edit("../../models/models_info.json", lambda c: c.clear())
    assert "models" in advice(made)["plausibility"]


def test_frames_that_were_kept_without_ground_truth_are_asked_whether_they_fit(tmp_path: Path) -> None:
    depth, mask = picture()
    for factor, is_plausible in ((1.0, True), (10.0, False)):
        mesh = write_box(tmp_path / "box.obj", 100.0)
        frame = Frame(K, depth).add("box", mesh, mask, pose(), unit_m=0.001)
        folder = tmp_path / f"kept_{factor:g}"
        frame.keep(folder)
        for path in (folder / "models").glob("*.ply"):
            model = trimesh.load(path)
            model.apply_scale(factor)
            model.export(path)
        (plausible,) = [f for f in check_split(folder, "test").findings if f.name == "plausibility"]
        assert plausible.result.startswith("initial poses")
        assert bool(plausible.advice) != is_plausible, plausible


def test_what_is_damaged_is_not_called_missing(made: Made) -> None:
    (made.scene / "scene_gt.json").write_text("{")
    lacking = [lacks for what, lacks in runnable_parts(check_split(made.root, "test")) if "gravity" not in what]
    assert all("can be read" in lacks for lacks in lacking)


def test_without_cameras_there_are_no_frames_and_nothing_else_is_called_missing(made: Made) -> None:
    (made.scene / "scene_camera.json").unlink()
    parts = check_split(made.root, "test")
    found = {f.name: f for f in parts.findings}
    assert found["frames"].result.startswith("0 ")
    assert not found["all the rest"].is_checked
    assert all(lacking.startswith("frames (") for _, lacking in runnable_parts(parts))


def test_damage_in_one_scene_leaves_the_ground_truth_of_the_others(made: Made) -> None:
    shutil.copytree(made.scene, made.scene.parent / "000008")
    (made.scene / "scene_gt.json").write_text("")
    parts = check_split(made.root, "test")
    found = {f.name: f for f in parts.findings}
    assert "2 of 4" in found["ground truth"].result
    assert "000007/scene_gt.json" in found["ground truth"].advice
    assert found["plausibility"].is_checked
    assert missing(parts)["study:"] == ""


def test_scores_need_targets_and_objects_without_a_diameter_are_named(made: Made) -> None:
    entries = [{"scene_id": 7, "im_id": 0, "obj_id": 5, "inst_count": 1}]
    (made.root / "test_targets_bop19.json").write_text(json.dumps(entries))
    assert missing(check_split(made.root, "test"))["evaluate:"] == ""
    made.edit("../../models/models_info.json", lambda content: content["5"].pop("diameter"))
    assert "object 5" in missing(check_split(made.root, "test"))["evaluate:"]
    made.edit("../../models/models_info.json", lambda content: content.pop("5"))
    assert "object 5" in missing(check_split(made.root, "test"))["evaluate:"]
    assert advice(made) == {}, "it can be solved"
    (made.root / "models" / "models_info.json").unlink()
    assert "models_info.json" in missing(check_split(made.root, "test"))["evaluate:"]


def test_offline_the_error_names_what_to_fetch_by_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def offline(*_: object, **__: object) -> None:
        raise OSError("Name or service not known")

    monkeypatch.setattr(huggingface_hub.HfApi, "dataset_info", offline)
    with pytest.raises(UnavailableError, match=r"https://huggingface\.co/\S+/ycbv_models\.zip"):
        Datasets("fetch", "ycbv", tmp_path).run([])


def test_all_archives_are_fetched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []

    def download(repository: str, archive: str, *, repo_type: str, local_dir: Path) -> str:
        asked.append(f"{repo_type} {repository} {archive}")
        return str(local_dir / archive)

    monkeypatch.setattr(huggingface_hub.HfApi, "dataset_info", lambda *_, **__: None)
    monkeypatch.setattr(huggingface_hub, "hf_hub_download", download)
    assert Datasets("fetch", "lmo", tmp_path).run([]) == 0
    archives = ("lmo_base.zip", "lmo_models.zip", "lmo_test_bop19.zip")
    assert asked == [f"dataset bop-benchmark/lmo {archive}" for archive in archives]
    assert "unpack lmo_base.zip" in capsys.readouterr().out
