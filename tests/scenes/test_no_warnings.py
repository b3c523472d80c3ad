"""Odd but readable inputs are read, or refused in one line, without a warning of numpy or Pillow on the terminal."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.scenes.test_trace import SHAPE, K, picture, pose, write_box
from verefine_viz.core.errors import InputError
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.image_files import read_color, read_depth, read_mask
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.trace import Trace


@pytest.fixture(autouse=True)
def no_warning() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


def test_images(tmp_path: Path) -> None:
    photo = Image.fromarray(np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8))
    exif = photo.getexif()
    exif[0x010E] = "a description that is cut off"
    photo.save(tmp_path / "exif.jpg", exif=exif.tobytes()[:30])
    assert read_color(tmp_path / "exif.jpg").shape == (60, 80, 3)
    labels = Image.fromarray(np.tile(np.uint8([0, 1, 2, 3]), (60, 20)), "P")
    labels.putpalette([0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 255])
    labels.save(tmp_path / "palette.png", transparency=bytes([0, 255, 255, 255]))
    assert read_color(tmp_path / "palette.png")[0, 1].tolist() == [255, 0, 0]
    assert read_mask(tmp_path / "palette.png", (60, 80)).mean() == 0.75
    for name, value in (("nan.tif", np.nan), ("large.tif", 1e4)):
        image = np.full((60, 80), 7, np.float32)
        image[0, 0] = value
        Image.fromarray(image).save(tmp_path / name)
        assert read_color(tmp_path / name).dtype == np.uint8
        assert read_depth(tmp_path / name, 1.0)[0, 0] == np.nan_to_num(np.float32(value * 1e-3))


def test_meshes(tmp_path: Path) -> None:
    mesh = trimesh.creation.box()
    text = mesh.export(file_type="ply", encoding="ascii").decode()
    (tmp_path / "nan.ply").write_text(text.replace("\n3 ", "\n3 nan ", 1))
    (tmp_path / "nan_vertex.ply").write_text(text.replace("end_header\n", "end_header\nnan nan nan\n"))
    trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False).export(tmp_path / "point.ply")
    for name in ("nan.ply", "nan_vertex.ply", "point.ply"):
        with pytest.raises(InputError) as refused:
            read_mesh(tmp_path / name, 1.0)
        assert "Warning" not in str(refused.value)


@pytest.mark.parametrize("case", ["depth in no pixel of the mask", "one pixel", "flat"])
def test_frames(tmp_path: Path, case: str) -> None:
    depth, mask = picture()
    mesh = write_box(tmp_path / "box.obj")
    if case == "depth in no pixel of the mask":
        depth[mask] = np.nan
    elif case == "one pixel":
        mask[:] = False
        mask[60, 80] = True
    else:
        mesh.write_text(mesh.read_text().replace(" 50.0\n", " 0\n").replace(" -50.0\n", " 0\n"))
    with Trace(tmp_path / "t", K=K, depth_m=depth, rgb=np.full((*SHAPE, 3), 90, np.uint8)) as trace:
        box = trace.object("box", mesh=mesh, mask=mask, unit_m=0.001, truth=pose())
        box.hypothesis(0, pose(10, 0.01))
    tools = Toolbox(open_session(tmp_path / "t", {"method": {"name": "pir", "iterations": 1}}))
    (answer,) = tools.run(tools.problem(tools.frames[0])).finish().best
    assert np.isfinite(answer.T_cam_obj).all()
