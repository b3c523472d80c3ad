"""``datasets check`` finds what is off in all frames of a folder, and by how much: cameras, depth, units, sizes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.batch.frames import make_frames
from tests.calibration.sizes import scene, written
from tests.commands.test_datasets import advice
from tests.scenes.bop_folder import Made
from tests.scenes.write_bop import write_bop
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.commands.datasets import Datasets

pytestmark = pytest.mark.usefixtures("long_run")


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return make_frames(tmp_path / "boxes", 2)


def change_depth(made: Made, change: Any) -> None:
    for file in (made.scene / "depth").iterdir():
        depth = np.asarray(Image.open(file))
        Image.fromarray(change(depth).astype(np.uint16)).save(file)


def test_displaced_depth_is_found_with_its_displacement(made: Made) -> None:
    change_depth(made, lambda depth: np.roll(depth, (6, 9), axis=(0, 1)))
    (said,) = advice(made).values()
    assert "not registered to colour" in said
    x, y = (int(word.split(" px")[0]) for word in said.split("displaced by ")[1].split(": ")[0].split(" and "))
    assert abs(x + 9) <= 3
    assert abs(y + 6) <= 3


@pytest.fixture(scope="module")
def clutter(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of scene 0, as they should be."""
    return write_bop(tmp_path_factory.mktemp("right") / "clutter", [scene("clutter", f"0/{k}") for k in range(2)])


def with_camera(clutter: Path, root: Path, change: Callable[[list[float]], None]) -> Path:
    """A copy with another cam_K (9 numbers)."""
    shutil.copytree(clutter, root)
    path = root / "test" / "000000" / "scene_camera.json"
    content = json.loads(path.read_text())
    for entry in content.values():
        change(entry["cam_K"])
    path.write_text(json.dumps(content))
    return root


def moved(k: int, px: float) -> Callable[[list[float]], None]:
    """Adds to one number of cam_K."""
    return lambda K: K.__setitem__(k, K[k] + px)


@pytest.mark.parametrize(("dx", "named"), [(24, "about 24 px too large"), (-40, "at least 30 px too small")])
def test_without_masks_a_wrong_principal_point_is_named_beside_depth_that_is_not_registered(
    clutter: Path, tmp_path: Path, dx: int, named: str
) -> None:
    root = with_camera(clutter, tmp_path / "clutter", moved(2, dx))
    for kind in ("mask_visib", "mask"):
        shutil.rmtree(root / "test" / "000000" / kind)
    said = {f.name: f.advice for f in check_split(root, "test").findings}["registration"]
    assert said.endswith(
        f"either depth is not registered to colour (warp it into the colour camera first), or cx of cam_K is {named}"
    )


@pytest.mark.parametrize(("k", "px", "named"), [(2, 40, "cx of cam_K looks 40 px too large"), (5, -20, "cy of cam_K")])
def test_masks_tell_a_wrong_principal_point_from_depth_that_is_not_registered(
    clutter: Path, tmp_path: Path, k: int, px: float, named: str
) -> None:
    found = {f.name: f for f in check_split(with_camera(clutter, tmp_path / "clutter", moved(k, px)), "test").findings}
    assert found["sizes"].advice.startswith(named)
    assert "displaced" not in found["registration"].advice
    assert not found["each frame"].is_checked


@pytest.mark.parametrize(("k", "px", "named"), [(0, 80, "fx"), (4, -80, "fy")])
def test_one_wrong_focal_length_is_found(clutter: Path, tmp_path: Path, k: int, px: float, named: str) -> None:
    root = with_camera(clutter, tmp_path / "clutter", moved(k, px))
    found = {f.name: f for f in check_split(root, "test").findings}
    assert found["sizes"].advice.startswith(f"{named} of cam_K looks too {'large' if px > 0 else 'small'}, about ")
    assert "displaced" not in found["registration"].advice
    assert Datasets("check", str(root)).run([]) == 1


def test_a_wrong_depth_scale_is_found(made: Made) -> None:
    def scaled(content: dict[str, Any]) -> None:
        for entry in content.values():
            entry["depth_scale"] *= 10

    made.edit("scene_camera.json", scaled)
    assert "measured depth is 10" in advice(made)["registration"]


@pytest.mark.parametrize(("focal", "instances"), [(1.15, range(6)), (0.75, [3])])
def test_a_wrong_focal_length_is_found_and_not_taken_for_displaced_depth(
    tmp_path: Path, focal: float, instances: Sequence[int]
) -> None:
    frames = [scene("clutter", f"0/{k}").only(instances) for k in range(2)]
    found = {f.name: f.advice for f in check_split(written(tmp_path / "clutter", frames, focal), "test").findings}
    off = "too small" if focal < 1 else "too large"
    assert found["sizes"].startswith(f"fx and fy of cam_K look {off}, about ")
    assert float(found["sizes"].split("about ")[1].split()[0]) == pytest.approx(1 / focal, rel=0.02)
    assert "displaced" not in found["registration"]


@pytest.mark.parametrize("kinds", [("mask",), ()])
def test_sizes_are_compared_with_the_masks_that_are_there(tmp_path: Path, kinds: Sequence[str]) -> None:
    root = written(tmp_path / "clutter", [scene()], 0.85)
    for kind in ("mask_visib", "mask"):
        if kind not in kinds:
            shutil.rmtree(root / "test" / "000000" / kind)
    named = [f for f in check_split(root, "test").findings if f.name == "sizes"]
    assert [f.result.split(" than ")[0] for f in named] == ["objects appear 18% larger"] * (kinds != ())


def test_true_poses_in_metres_are_found(made: Made) -> None:
    def in_metres(content: dict[str, Any]) -> None:
        for entry in (entry for entries in content.values() for entry in entries):
            entry["cam_t_m2c"] = [x / 1000 for x in entry["cam_t_m2c"]]

    made.edit("scene_gt.json", in_metres)
    said = advice(made)["registration"]
    times = float(said.removeprefix("measured depth is about ").split()[0])
    assert 800 < times <= 1000
    assert said.endswith("check that cam_t_m2c in scene_gt.json is in millimetres, it looks like metres")


def test_meshes_in_metres_are_found(made: Made) -> None:
    path = made.root / "models" / "models_info.json"
    info = json.loads(path.read_text())
    path.write_text(json.dumps({key: {"diameter": entry["diameter"] * 1000} for key, entry in info.items()}))
    assert "its unit was taken to be metres" in advice(made)["models"]
