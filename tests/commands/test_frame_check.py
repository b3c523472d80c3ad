"""``datasets check`` says once what is off in all frames, and names frame and object of what is off in few."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import verefine_viz as vv
from tests.batch.frames import make_frames
from tests.calibration.sizes import scene
from tests.scenes.bop_folder import Made
from tests.scenes.write_bop import write_bop
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.commands.dataset_parts import CheckRow
from verefine_viz.commands.datasets import Datasets
from verefine_viz.run.session_file import SCENE_ID

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


def plausibility(root: Path) -> CheckRow:
    (found,) = [f for f in check_split(root, "test").findings if f.name == "plausibility"]
    return found


def edit(file: Path, change: Callable[[Any], None]) -> None:
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def edit_camera(root: Path, change: Callable[[str, dict[str, Any]], None], scene_folder: str = "000000") -> None:
    """Changes the entry of each image."""

    def of_all(content: dict[str, Any]) -> None:
        for image, entry in content.items():
            change(image, entry)

    edit(root / "test" / scene_folder / "scene_camera.json", of_all)


def times(key: str, factor: float, *images: str) -> Callable[[str, dict[str, Any]], None]:
    """Multiplies a number of these images, or of all."""
    return lambda image, entry: entry.update({key: entry[key] * (factor if image in (images or (image,)) else 1)})


def test_right_frames_are_silent(made: Made, clutter: Path) -> None:
    for root, n in ((made.root, 5), (clutter, 3)):
        found = plausibility(root)
        assert f"{n} of {n} frames" in found.result
        assert found.advice == ""


def test_instances_of_one_frame_in_another_order_are_named(clutter: Path) -> None:
    def swapped(content: dict[str, Any]) -> None:
        entries = content["1"]
        entries[a], entries[b] = entries[b], entries[a]

    sizes = [int(np.count_nonzero(i.mask)) for i in scene("clutter", "0/1").instances]
    a, b = np.argsort(sizes)[-2:]
    edit(clutter / "test" / "000000" / "scene_gt.json", swapped)
    found = plausibility(clutter)
    assert "1 of 3 frames" in found.result
    assert found.advice.startswith("in 0/1: ")
    assert "in another order" in found.advice
    assert "0/2" not in found.advice
    assert Datasets("check", str(clutter)).run([]) == 1


@pytest.mark.parametrize(("factor", "named"), [(10.0, "10 times smaller"), (1.3, "depth_scale")])
def test_a_wrong_depth_scale_of_one_frame_is_named(clutter: Path, factor: float, named: str) -> None:
    edit_camera(clutter, times("depth_scale", factor, "1"))
    found = plausibility(clutter)
    assert "1 of 3 frames" in found.result
    assert found.advice.startswith("in 0/1: ")
    assert named in found.advice


def moved(entry: dict[str, Any], k: int, px: float) -> None:
    """Adds to one number of cam_K."""
    entry["cam_K"][k] += px


@pytest.mark.parametrize(
    ("k", "px", "named"),
    [(2, 40, "cx of cam_K looks 40 px too large"), (4, -80, "fy of cam_K looks too small")],
)
def test_a_camera_that_is_off_in_all_frames_is_said_once(clutter: Path, k: int, px: float, named: str) -> None:
    edit_camera(clutter, lambda _, entry: moved(entry, k, px))
    found = plausibility(clutter)
    assert "3 of 3 frames" in found.result
    assert found.advice.count(named[:10]) == 1
    assert named in found.advice


def test_displaced_depth_is_named_with_its_displacement(clutter: Path) -> None:
    dx, dy = -21, 9
    for file in (clutter / "test" / "000000" / "depth").iterdir():
        depth = np.asarray(Image.open(file))
        Image.fromarray(np.roll(depth, (dy, dx), axis=(0, 1))).save(file)
    said = plausibility(clutter).advice
    found = re.match(r"in all 3 frames, such as 0/0: depth lies (\d+) px to the left and (\d+) px down of ", said)
    assert found, said
    assert [float(px) for px in found.groups()] == pytest.approx([abs(dx), abs(dy)], abs=2)


def test_without_masks_no_frame_is_judged(made: Made) -> None:
    for kind in ("mask_visib", "mask"):
        shutil.rmtree(made.scene / kind)
    found = plausibility(made.root)
    assert ("masks" in found.result, found.is_checked) == (True, False)


def test_frames_that_cannot_be_opened_do_not_stop_the_others(clutter: Path) -> None:
    (clutter / "test" / "000000" / "depth" / "000001.png").write_bytes(b"")
    edit_camera(clutter, times("depth_scale", 10))
    assert "2 of 2 frames" in plausibility(clutter).result
    for file in (clutter / "test" / "000000" / "mask_visib").iterdir():
        file.write_bytes(b"")
    assert not plausibility(clutter).is_checked


def test_real_frames_are_silent_but_for_the_one_that_is_wrong(shared_data: Path, tmp_path: Path) -> None:
    shutil.copytree(shared_data / YCBV, tmp_path / YCBV)
    assert plausibility(tmp_path / YCBV).advice == ""
    edit(tmp_path / YCBV / "test" / "000049" / "scene_gt.json", lambda content: content["2365"].reverse())
    said = plausibility(tmp_path / YCBV).advice
    assert said.startswith("in 49/2365: ")
    assert "0/1" not in said


def kept(folder: Path) -> Path:
    """A folder of kept frames without ground truth, with poses of an estimator."""
    problem = scene("clutter", "0/0")
    frame = vv.Frame(problem.observation.camera.K, problem.observation.depth_m)
    for i in problem.instances:
        model = problem.models[i.obj_id]
        mesh = folder.parent / f"{i.instance_id}.ply"
        trimesh.Trimesh(model.vertices, model.faces, process=False).export(mesh)
        assert i.T_cam_obj_gt is not None
        frame.add(f"thing {i.instance_id}", mesh, i.mask, {"net": i.T_cam_obj_gt})
    frame.keep(folder)
    return folder


def test_masks_of_detections_are_checked_by_the_poses_of_results_files(tmp_path: Path) -> None:
    assert not plausibility(kept(tmp_path / "right")).advice
    wrong = kept(tmp_path / "wrong")
    edit_camera(wrong, times("depth_scale", 4.0), f"{SCENE_ID:06d}")
    found = plausibility(wrong)
    assert "1 of 1 frames" in found.result
    assert "RealSense L515" in found.advice
    large = kept(tmp_path / "large")
    for model in (large / "models").glob("*.ply"):
        mesh = trimesh.load_mesh(model, process=False)
        trimesh.Trimesh(10 * mesh.vertices, mesh.faces, process=False).export(model)
    assert "10 times smaller" in plausibility(large).advice
