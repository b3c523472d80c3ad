"""Images and arrays of depth and masks, labels of objects, MATLAB files: odd ones are read without warnings."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import trimesh
from PIL import Image

import verefine_viz as vv
from tests.scenes.bop_folder import Made
from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_layouts import problem_at
from tests.scenes.test_trace import SHAPE, K, picture, pose, problem_of, write_box, write_trace
from verefine_viz.core.errors import InputError, VerefineError
from verefine_viz.core.label_images import labels_in
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.image_files import image_width, read_color, read_depth, read_mask
from verefine_viz.scenes.mat_file import mat_arrays
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.trace import Trace

DEPTH, MASK = picture()
LABELS = MASK * 2
LABELS[:20, :30] = 1
LABELS[80:, 120:] = 3


def saved(path: Path, values: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, values)
    return path


def to_array(path: Path, dtype: type[np.generic], factor: float = 1.0) -> None:
    """Replaces an image by an array of its values."""
    values = np.asarray(Image.open(path)) * factor
    path.unlink()
    np.save(path.with_suffix(".npy"), values.astype(dtype))


@pytest.fixture(autouse=True)
def no_warning() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


def test_masks_are_read_from_arrays_of_any_kind_and_size_of_number(tmp_path: Path) -> None:
    cases = {
        "bool": MASK,
        "0 and 1": MASK.astype(np.int64),
        "0 and 255": MASK.astype(np.uint8) * 255,
        "floats": MASK.astype(np.float64),
        "another axis": MASK[None],
        "a label of 16 bits": MASK.astype(np.uint16) * 40_000,
    }
    for name, values in cases.items():
        assert np.array_equal(read_mask(saved(tmp_path / "m.npy", values), SHAPE), MASK), name
    for values, words in (
        (MASK * 0.37, "0.37"),
        (MASK[:, :-1], "159×120"),
        (np.stack([MASK] * 4), r"\(4, 120, 160\)"),
        (MASK * (1 << 40), "32 bits"),
        (np.array(["a"]), "numbers"),
    ):
        with pytest.raises(VerefineError, match=words):
            read_mask(saved(tmp_path / "m.npy", values), SHAPE)


def test_depth_is_read_from_arrays_as_from_images(tmp_path: Path) -> None:
    for values, scale_mm in ((DEPTH, 1000.0), (DEPTH * 1000, 1.0), ((DEPTH * 10_000).astype(np.int64), 0.1)):
        read = read_depth(saved(tmp_path / "d.npy", np.where(MASK, values, 0 * values)), scale_mm)
        assert np.allclose(read, np.where(MASK, DEPTH, 0), atol=1e-6)
    assert image_width(tmp_path / "d.npy") == SHAPE[1]
    unmeasured = np.where(MASK, np.nan, np.where(DEPTH > 0.7, np.inf, 1e300))
    assert not read_depth(saved(tmp_path / "d.npy", unmeasured), 1.0).any()


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_sequence_of_arrays_is_that_of_images(tmp_path: Path, unit: float) -> None:
    """Metres or millimetres: the median decides, and metres are noted."""
    write_sequence(tmp_path / "it", 1)
    expected = problem_at(tmp_path / "it")
    for kind, dtype, factor in (("depth", np.float32, unit / 1000), ("masks", np.bool_, 1.0)):
        for path in [*(tmp_path / "it" / kind).iterdir()]:
            to_array(path, dtype, factor)
    problem = problem_at(tmp_path / "it")
    assert np.allclose(problem.observation.depth_m, expected.observation.depth_m, atol=1e-6)
    assert np.array_equal(problem.instances[0].mask, expected.instances[0].mask)
    assert any("depth in metres" in note for note in problem.notes) == (unit == 1.0)


def test_a_bop_folder_of_arrays_is_that_of_images(made: Made) -> None:
    """Depth counts in the steps that scene_camera.json states, as of images."""
    expected = made.read()
    for kind, dtype in (("depth", np.float64), ("mask_visib", np.bool_)):
        for path in [*(made.scene / kind).iterdir()]:
            to_array(path, dtype)
    problem = made.read()
    assert np.array_equal(problem.observation.depth_m, expected.observation.depth_m)
    assert [np.array_equal(a.mask, b.mask) for a, b in zip(problem.instances, expected.instances, strict=True)] == [
        True
    ] * 3


def test_labels_of_several_objects_are_no_mask(made: Made) -> None:
    masks = [instance.mask for instance in made.problem.instances]
    values = np.max([mask * k for k, mask in enumerate(masks, 1)], axis=0).astype(np.uint8)
    Image.fromarray(values).save(made.scene / "mask_visib/000003_000001.png")
    problem = made.read()
    assert [instance.instance_id for instance in problem.instances] == [0, 2]
    (why,) = [one.why for one in problem.left_out]
    assert "000003_000001.png holds 3 labels (1, 2, 3)" in why


def test_a_label_is_chosen_by_a_file_beside_the_masks(tmp_path: Path) -> None:
    write_sequence(tmp_path, 1)
    (path,) = (tmp_path / "masks").iterdir()
    path.unlink()
    values = np.zeros(SHAPE, np.int32)
    values[2:12, 2:12], values[20:32, 20:32] = 5, 9
    np.save(path.with_suffix(".npy"), values)
    assert any("2 labels (5, 9)" in note and "masks/label.txt" in note for note in problem_at(tmp_path).notes)
    (tmp_path / "masks" / "label.txt").write_text("9\n")
    assert np.array_equal(problem_at(tmp_path).instances[0].mask, values == 9)
    (tmp_path / "masks" / "label.txt").write_text("mug")
    assert any("'mug'" in note for note in problem_at(tmp_path).notes)


def test_soft_edges_and_specks_are_no_labels() -> None:
    soft = np.asarray(Image.fromarray(MASK.astype(np.uint8) * 255).resize((320, 240), Image.Resampling.BICUBIC))
    assert len(np.unique(soft)) > 3
    assert labels_in(soft) == (255,)
    speck = np.where(MASK, 255, 0)
    speck[3:6, 3:6] = 1
    assert labels_in(speck) == (255,)
    assert labels_in(LABELS) == (1, 2, 3)
    assert labels_in(np.zeros(SHAPE)) == labels_in(np.zeros((0, 0))) == ()


def test_arrays_of_labels_are_refused_by_the_library_and_named_in_a_trace(tmp_path: Path) -> None:
    mesh = write_box(tmp_path / "box.obj")
    with pytest.raises(VerefineError, match=r"box holds 3 labels \(1, 2, 3\)"):
        vv.Frame(K, DEPTH).add("box", mesh, LABELS, pose(), unit_m=0.001)
    with Trace(tmp_path / "drop", K=K, depth_m=DEPTH) as trace:
        trace.object("box", mesh=mesh, mask=LABELS, unit_m=0.001).hypothesis(0, pose())
    assert any("3 labels (1, 2, 3)" in note for note in problem_of(tmp_path / "drop").notes)
    write_trace(tmp_path / "right", mesh)
    np.save(tmp_path / "right" / "mask_0.npy", MASK.astype(np.uint8) * 255)
    assert np.array_equal(problem_of(tmp_path / "right").instances[0].mask, MASK)


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
        with pytest.raises(InputError, match=name):
            read_mesh(tmp_path / name, 1.0)


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


def test_arrays_come_back_as_they_were_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    dtypes = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
    arrays = {f"a{k}_{'long' * (k % 9)}": rng.normal(0, 50, (k, 3, 2)).astype(d) for k, d in enumerate(dtypes)}
    arrays |= {"one": np.ones((1, 1), np.uint8), "row": np.arange(5.0)[None], "words": np.array(["a", "b"])}
    for is_packed in (False, True):
        path = tmp_path / f"{is_packed}.mat"
        scipy.io.savemat(path, arrays, do_compression=is_packed)
        numbers = [name for name in arrays if name != "words"]
        read = mat_arrays(path, *numbers, "missing")
        assert sorted(read) == sorted(numbers)
        for name in numbers:
            np.testing.assert_array_equal(read[name], arrays[name], err_msg=f"{name}, packed: {is_packed}")


def test_what_holds_no_real_numbers_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"a": np.array([[1j, 2]]), "b": np.array(["x"]), "c": {"d": 1.0}})
    for name in "abc":
        with pytest.raises(InputError, match=f"'{name}' holds no real numbers"):
            mat_arrays(path, name)
