"""``verefine-viz datasets``: what it lists and fetches, what is wrong with a folder, and what can be run on it."""

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
from tests.calibration.sizes import scene
from tests.scenes.bop_folder import Made, detections
from tests.scenes.write_bop import write_bop
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.commands.dataset_parts import CheckRow, Parts, runnable_parts
from verefine_viz.commands.datasets import CATALOGUE, Datasets
from verefine_viz.core.errors import UnavailableError
from verefine_viz.scenes.bop import BopDataset


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return make_frames(tmp_path / "boxes", 2)


def findings(root: Path) -> dict[str, CheckRow]:
    return {found.name: found for found in check_split(root, "test").findings}


def advice(made: Made) -> dict[str, str]:
    """What is to be done, by part; only parts where something is."""
    return {name: found.advice for name, found in findings(made.root).items() if found.advice}


def missing(parts: Parts) -> dict[str, str]:
    return {what.split()[0]: lacking for what, lacking in runnable_parts(parts)}


def exit_code(folder: Path, **options: str) -> int:
    return Datasets("check", str(folder), **options).run([])


def write_targets(made: Made, *images: int) -> None:
    entries = [{"scene_id": 7, "im_id": im_id, "obj_id": 5, "inst_count": 1} for im_id in images]
    (made.root / "test_targets_bop19.json").write_text(json.dumps(entries))


def scaled(models: Path, factor: float) -> None:
    """Meshes of another size."""
    for path in models.glob("*.ply"):
        mesh = trimesh.load_mesh(path, process=False)
        trimesh.Trimesh(factor * mesh.vertices, mesh.faces, process=False).export(path)


def test_every_data_set_of_the_paper_is_listed_with_a_way_to_get_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Datasets(folder=tmp_path).run([]) == 0
    said = capsys.readouterr().out
    assert all(f"\n{name}  " in f"\n{said}" for name in ("lm", "lmo", "ycbv", "xapc"))
    for known in CATALOGUE:
        assert all(f"bop-benchmark/{known.name}/resolve/main/{archive}" in said for archive in known.archives)
    assert str(tmp_path / "ycbv") in said


def test_all_archives_are_fetched_and_offline_those_to_fetch_by_hand_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def download(repository: str, archive: str, *, repo_type: str, local_dir: Path) -> str:
        asked.append(f"{repo_type} {repository} {archive}")
        return str(local_dir / archive)

    def offline(*_: object, **__: object) -> None:
        raise OSError("Name or service not known")

    monkeypatch.setattr(huggingface_hub, "hf_hub_download", download)
    monkeypatch.setattr(huggingface_hub.HfApi, "dataset_info", lambda *_, **__: None)
    assert Datasets("fetch", "lmo", tmp_path).run([]) == 0
    archives = ("lmo_base.zip", "lmo_models.zip", "lmo_test_bop19.zip")
    assert asked == [f"dataset bop-benchmark/lmo {archive}" for archive in archives]
    monkeypatch.setattr(huggingface_hub.HfApi, "dataset_info", offline)
    with pytest.raises(UnavailableError, match=r"https://huggingface\.co/\S+/ycbv_models\.zip"):
        Datasets("fetch", "ycbv", tmp_path).run([])


def test_a_good_folder_has_nothing_to_be_done_and_is_found_from_its_split_or_scene(
    made: Made, capsys: pytest.CaptureFixture[str]
) -> None:
    assert advice(made) == {}
    assert "2 of 2 frames" in findings(made.root)["plausibility"].result
    found = missing(check_split(made.root, "test"))
    assert found == {"evaluate:": "", "view": "", "study:": "", "gravity": "cam_R_w2c"}
    shutil.copytree(made.root / "test", made.root / "val")
    for folder in (made.scene, made.scene.parent):
        assert exit_code(folder) == 0
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
    found = findings(made.root)
    assert found["sensor"].result.index("cam1") < found["sensor"].result.index("cam2")
    assert found["masks"].advice
    assert not found["depth and colour"].advice
    assert exit_code(made.root, sensor="cam2") == 1


@pytest.mark.parametrize(("without", "said"), [((0, 1), "all of them"), ((1,), "7/1")])
def test_frames_without_colour_are_a_note(made: Made, without: Sequence[int], said: str) -> None:
    for k in without:
        (made.scene / "rgb" / f"{k:06d}.png").unlink()
    assert said in findings(made.root)["depth and colour"].result
    assert advice(made) == {}
    assert exit_code(made.root) == 0


def test_what_is_missing_decides_what_can_be_run(made: Made) -> None:
    for kind in ("mask", "mask_visib"):
        (made.scene / kind).rename(made.scene / f"_{kind}")
    assert not findings(made.root)["plausibility"].is_checked
    (made.scene / "scene_gt.json").unlink()
    lacking = runnable_parts(check_split(made.root, "test"))
    assert [words for _, words in lacking][:3] == ["masks, scene_gt.json", "masks", "masks, scene_gt.json"]
    assert "masks" in advice(made)


def test_masks_of_which_nobody_knows_the_object_cannot_be_solved(made: Made) -> None:
    (made.scene / "scene_gt.json").unlink()
    assert missing(check_split(made.root, "test"))["view"]
    assert "scene_gt.json" in advice(made)["ground truth"]
    assert exit_code(made.root) == 1
    (made.root / "detections_boxes.json").write_text("[]")
    assert missing(check_split(made.root, "test"))["view"] == ""
    assert "ground truth" not in advice(made)


def test_a_part_of_the_frames_of_the_targets_is_a_note_and_none_of_them_a_fault(made: Made) -> None:
    write_targets(made, 1, 5, 6)
    assert "7/5" in findings(made.root)["targets"].result
    assert missing(check_split(made.root, "test"))["evaluate:"].startswith("2 of the 3 images")
    assert exit_code(made.root) == 0
    write_targets(made, 5, 6)
    assert "7/5" in advice(made)["targets"]
    assert exit_code(made.root) == 1


def test_scores_need_targets_and_objects_without_a_diameter_are_named(made: Made) -> None:
    def lacking() -> str:
        return missing(check_split(made.root, "test"))["evaluate:"]

    info = "../../models/models_info.json"
    write_targets(made, 0)
    assert lacking() == ""
    made.edit(info, lambda content: content["5"].pop("diameter"))
    assert "object 5" in lacking()
    made.edit(info, lambda content: content.pop("5"))
    assert "object 5" in lacking()
    assert advice(made) == {}, "it can be solved"
    (made.scene / info).unlink()
    assert "models_info.json" in lacking()


@pytest.mark.parametrize("part", ["models", "frames"])
def test_without_models_or_frames_nothing_else_is_called_missing(made: Made, part: str) -> None:
    if part == "models":
        (made.root / "models").rename(made.root / "_models")
    else:
        (made.scene / "scene_camera.json").unlink()
    parts = check_split(made.root, "test")
    found = {one.name: one for one in parts.findings}
    assert found[part].advice if part == "models" else found[part].result.startswith("0 ")
    assert not found["all the rest"].is_checked
    assert all(lacking.startswith(f"{part} (") for _, lacking in runnable_parts(parts))
    assert exit_code(made.root) == 1


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


FAULTS: tuple[tuple[Callable[[Made], object], str, str], ...] = (
    (damaged("depth/000001.png"), "depth and colour", "000001.png"),
    (damaged("scene_gt.json"), "ground truth", "scene_gt.json"),
    (damaged("scene_gt_info.json"), "ground truth", "scene_gt_info.json"),
    (lambda made: made.edit("scene_gt.json", lambda c: c.update(a1=c.pop("1"))), "ground truth", "'a1'"),
    (lambda made: made.edit("scene_gt.json", lambda c: c["0"][0].update(obj_id=9)), "ground truth", "object 9"),
    (damaged("../../models/models_info.json"), "models", "models_info.json"),
    (with_meshes_of_another_kind, "models", "obj_000001.ply"),
    (lambda made: (made.scene / "mask_visib/000001_000002.png").unlink(), "masks", "000001_000002.png"),
    (damaged("mask/000000_000000.png"), "masks", "000000_000000.png"),
    (with_a_mask_of(0, None), "masks", "0 px"),
    (with_a_mask_of(9, 0.6), "masks", "9 px"),
    (
        lambda made: [shutil.copytree(made.scene, made.scene.with_name(name)) for name in ("8", "0008")],
        "scene 8",
        "scene 8",
    ),
)


@pytest.mark.parametrize(("spoil", "part", "named"), FAULTS)
def test_a_fault_is_a_finding_of_its_part_and_of_no_other(
    made: Made, spoil: Callable[[Made], object], part: str, named: str
) -> None:
    spoil(made)
    found = advice(made)
    assert found.keys() == {part}
    assert named in found[part]
    assert exit_code(made.root) == 1


@pytest.mark.parametrize("spoil", [with_a_mask_of(0, 0.0), with_a_mask_of(10, 0.6)])
def test_small_masks_of_hidden_objects_and_those_that_suffice_are_no_fault(made: Made, spoil: Any) -> None:
    spoil(made)
    assert advice(made) == {}


def test_damage_in_one_scene_leaves_the_ground_truth_of_the_others_and_is_not_called_missing(made: Made) -> None:
    whole = shutil.copytree(made.scene, made.root / "000008")
    (made.scene / "scene_gt.json").write_text("{")
    lacking = [lacks for what, lacks in runnable_parts(check_split(made.root, "test")) if "gravity" not in what]
    assert all("can be read" in lacks for lacks in lacking)
    whole.rename(made.scene.parent / "000008")
    parts = check_split(made.root, "test")
    found = {one.name: one for one in parts.findings}
    assert "2 of 4" in found["ground truth"].result
    assert "000007/scene_gt.json" in found["ground truth"].advice
    assert found["plausibility"].is_checked
    assert missing(parts)["study:"] == ""


# Whether frames, models and poses fit each other


def test_masks_of_a_detections_file_are_enough_to_ask_whether_the_data_fit(made: Made) -> None:
    plausible = findings(made.root)["plausibility"]
    images = BopDataset(made.root, "test").image_ids(7)
    entries = [{**entry, "image_id": image} for image in images for entry in detections(made)]
    (made.root / "detections.json").write_text(json.dumps(entries))
    for kind in ("mask", "mask_visib"):
        shutil.rmtree(made.scene / kind)
    assert findings(made.root)["plausibility"] == plausible
    scaled(made.root / "models", 10)
    made.edit("../../models/models_info.json", lambda c: c.clear())
    assert "models" in advice(made)["plausibility"]


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory, long_run: None) -> Path:
    """Six objects, of which some hide others, in three frames of scene 0."""
    root = write_bop(tmp_path_factory.mktemp("right") / "clutter", [scene("clutter", f"0/{k}") for k in range(3)])
    found = findings(root)["plausibility"]
    assert "3 of 3 frames" in found.result
    assert found.advice == ""
    return root


@pytest.fixture
def clutter(right: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return shutil.copytree(right, tmp_path / "clutter")


def edit(file: Path, change: Callable[[Any], None]) -> None:
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def times_depth_scale(root: Path, factor: float, *images: str) -> None:
    """Multiplies the depth scale of these images, or of all."""

    def change(content: dict[str, Any]) -> None:
        for image in images or content:
            content[image]["depth_scale"] *= factor

    edit(next(root.glob("test/*/scene_camera.json")), change)


def test_what_is_off_is_named_with_its_frame_or_said_once_for_all(clutter: Path) -> None:
    times_depth_scale(clutter, 10, "1")
    found = findings(clutter)["plausibility"]
    assert "1 of 3 frames" in found.result
    assert found.advice.startswith("in 0/1: ")
    assert "10 times smaller" in found.advice
    assert "0/2" not in found.advice
    assert exit_code(clutter) == 1

    def moved(content: dict[str, Any]) -> None:
        for entry in content.values():
            entry["cam_K"][2] += 40

    times_depth_scale(clutter, 0.1, "1")
    edit(clutter / "test" / "000000" / "scene_camera.json", moved)
    found = findings(clutter)["plausibility"]
    assert "3 of 3 frames" in found.result
    assert found.advice.startswith("in all 3 frames, such as 0/0: ")
    assert found.advice.count("cx of cam_K looks 40 px too large") == 1


def test_frames_that_cannot_be_opened_do_not_stop_the_others(clutter: Path) -> None:
    (clutter / "test" / "000000" / "depth" / "000001.png").write_bytes(b"")
    times_depth_scale(clutter, 10)
    assert "2 of 2 frames" in findings(clutter)["plausibility"].result
    for file in (clutter / "test" / "000000" / "mask_visib").iterdir():
        file.write_bytes(b"")
    assert not findings(clutter)["plausibility"].is_checked


def test_real_frames_are_silent_but_for_the_one_that_is_wrong(
    shared_data: Path, tmp_path: Path, long_run: None
) -> None:
    root = shutil.copytree(shared_data / "ycbv", tmp_path / "ycbv")
    assert findings(root)["plausibility"].advice == ""
    edit(root / "test" / "000049" / "scene_gt.json", lambda content: content["2365"].reverse())
    said = findings(root)["plausibility"].advice
    assert said.startswith("in 49/2365: ")
    assert "0/1" not in said
