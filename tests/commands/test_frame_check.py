"""``datasets check`` judges every frame, and every object in it: what is wrong in one does not drown in the others."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.batch.frames import make_frames
from tests.calibration.sizes import scene
from tests.scenes.bop_folder import Made
from tests.scenes.write_bop import write_bop
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.commands.dataset_parts import Finding
from verefine_viz.commands.datasets import Datasets

pytestmark = pytest.mark.usefixtures("long_run")

YCBV = Path("ycbv")


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return make_frames(tmp_path / "boxes", 5)


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six objects, of which some hide others, in three frames of scene 0."""
    return write_bop(tmp_path_factory.mktemp("right") / "clutter", [scene("clutter", f"0/{k}") for k in range(3)])


@pytest.fixture
def clutter(right: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return shutil.copytree(right, tmp_path / "clutter")


def each_frame(root: Path) -> Finding:
    (found,) = [f for f in check_split(root, "test").findings if f.name == "each frame"]
    return found


def edit(file: Path, change: Callable[[Any], None]) -> None:
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def test_right_frames_are_silent(made: Made, clutter: Path) -> None:
    for root in (made.root, clutter):
        found = each_frame(root)
        assert found.advice == ""
        assert "of the depth in the objects' masks lies on their models in their ground-truth poses" in found.result


def test_instances_of_one_frame_in_another_order_are_named(made: Made, capsys: pytest.CaptureFixture[str]) -> None:
    made.edit("scene_gt.json", lambda content: content["3"].reverse())
    found = each_frame(made.root)
    assert found.result.startswith("in the worst of 5 frames checked, 7/3, ")
    assert found.advice.startswith("7/3: only ")
    assert "mask 2 shows the object of entry 0 of scene_gt.json: put the entries in the order" in found.advice
    assert "7/1" not in found.advice
    assert Datasets("check", str(made.root)).run([]) == 1
    assert capsys.readouterr().out.endswith("1 part needs a look, hence exit code 1: each frame.\n")


@pytest.mark.parametrize("factor", [10.0, 1.3])
def test_a_wrong_depth_scale_of_one_frame_is_named(clutter: Path, factor: float) -> None:
    def scaled(content: dict[str, Any]) -> None:
        content["1"]["depth_scale"] *= factor

    edit(clutter / "test" / "000000" / "scene_camera.json", scaled)
    said = each_frame(clutter).advice
    assert said.startswith("0/1: only 0% lies there; measured depth is about ")
    times = float(said.split("is about ")[1].split()[0])
    assert times == pytest.approx(factor, rel=0.1)
    assert said.endswith(" times the true one: check depth_scale")


def test_another_camera_in_one_frame_is_named(clutter: Path) -> None:
    def moved(content: dict[str, Any]) -> None:
        content["2"]["cam_K"][2] += 250

    edit(clutter / "test" / "000000" / "scene_camera.json", moved)
    said = each_frame(clutter).advice
    assert said.startswith("0/2: only 0% lies there; check cam_K and depth_scale in scene_camera.json, ")


def test_one_object_in_another_place_is_named_with_its_share(clutter: Path) -> None:
    def moved(content: dict[str, Any]) -> None:
        content["1"][2]["cam_t_m2c"][2] += 300

    edit(clutter / "test" / "000000" / "scene_gt.json", moved)
    said = each_frame(clutter).advice
    assert said.startswith("0/1: only 0% of ")
    assert said.endswith(" (entry 2); check its mask, and its pose in scene_gt.json")


def test_masks_of_all_of_an_object_do_not_tell_about_hidden_ones(clutter: Path) -> None:
    """Four fifths of an object are hidden by something that is nobody's."""
    folder = clutter / "test" / "000000"
    shutil.rmtree(folder / "mask_visib")
    mask = np.asarray(Image.open(folder / "mask" / "000001_000002.png")) > 0
    columns = np.flatnonzero(mask.any(axis=0))
    hidden = mask & (np.arange(mask.shape[1]) > np.quantile(columns, 0.2))
    depth = np.asarray(Image.open(folder / "depth" / "000001.png")).copy()
    depth[hidden] = depth[hidden] // 2
    Image.fromarray(depth).save(folder / "depth" / "000001.png")
    assert each_frame(clutter).advice == ""


def test_without_masks_no_frame_is_judged(made: Made) -> None:
    for kind in ("mask_visib", "mask"):
        shutil.rmtree(made.scene / kind)
    assert [f for f in check_split(made.root, "test").findings if f.name == "each frame"] == []


def test_what_is_off_in_all_frames_together_is_said_once(made: Made) -> None:
    def scaled(content: dict[str, Any]) -> None:
        for entry in content.values():
            entry["depth_scale"] *= 10

    made.edit("scene_camera.json", scaled)
    assert not each_frame(made.root).is_checked


def test_real_frames_are_silent_but_for_the_one_that_is_wrong(shared_data: Path, tmp_path: Path) -> None:
    """Eight frames: all of them are looked at, the wrong one is not among six that are spread evenly."""
    shutil.copytree(shared_data / YCBV, tmp_path / YCBV)
    assert each_frame(tmp_path / YCBV).advice == ""
    edit(tmp_path / YCBV / "test" / "000049" / "scene_gt.json", lambda content: content["2365"].reverse())
    said = each_frame(tmp_path / YCBV).advice
    assert said.startswith("49/2365: only 11% lies there; mask 3 shows the object of entry 0")
    assert "0/1" not in said
