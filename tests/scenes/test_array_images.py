"""Masks and depth as arrays (.npy), masks that hold the labels of several objects, and images that are not read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import verefine_viz as vv
from tests.scenes.bop_folder import Made, refusal
from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_layouts import problem_at
from tests.scenes.test_trace import SHAPE, K, picture, pose, problem_of, write_box, write_trace
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.label_images import labels_in
from verefine_viz.scenes.image_files import image_width, read_depth, read_mask
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
        (MASK * 0.37, "holds shares, such as 0.37; save it as mask > 0.5"),
        (MASK[:, :-1], "m.npy is 159×120 pixels, expected 160×120 as the depth image"),
        (np.stack([MASK] * 4), r"an array of shape \(4, 120, 160\), expected \(height, width\)"),
        (MASK * (1 << 40), "it holds numbers of more than 32 bits"),
        (np.array(["a"]), "expected one array of numbers"),
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


def label_image(made: Made, gt_id: int) -> None:
    """All instances in the mask of one, each under its number."""
    masks = [instance.mask for instance in made.problem.instances]
    values = np.max([mask * k for k, mask in enumerate(masks, 1)], axis=0).astype(np.uint8)
    Image.fromarray(values).save(made.scene / f"mask_visib/000003_{gt_id:06d}.png")


def test_labels_of_several_objects_are_no_mask(made: Made) -> None:
    label_image(made, 1)
    problem = made.read()
    assert [instance.instance_id for instance in problem.instances] == [0, 2]
    (why,) = [one.why for one in problem.left_out]
    assert why.endswith("000003_000001.png holds 3 labels (1, 2, 3), expected the pixels of one object")


def test_a_label_is_chosen_by_a_file_beside_the_masks(tmp_path: Path) -> None:
    write_sequence(tmp_path, 1)
    (path,) = (tmp_path / "masks").iterdir()
    path.unlink()
    values = np.zeros(SHAPE, np.int32)
    values[2:12, 2:12], values[20:32, 20:32] = 5, 9
    np.save(path.with_suffix(".npy"), values)
    choose = "holds 2 labels (5, 9), expected the pixels of one object; write the object's label to masks/label.txt"
    assert any(choose in note for note in problem_at(tmp_path).notes)
    (tmp_path / "masks" / "label.txt").write_text("9\n")
    assert np.array_equal(problem_at(tmp_path).instances[0].mask, values == 9)
    (tmp_path / "masks" / "label.txt").write_text("mug")
    assert any("'mug' is no label, expected a whole number above 0" in note for note in problem_at(tmp_path).notes)


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
    words = r"mask of box holds 3 labels \(1, 2, 3\), expected the pixels of one object; give it as mask == 1"
    with pytest.raises(VerefineError, match=words):
        vv.Frame(K, DEPTH).add("box", mesh, LABELS, pose(), unit_m=0.001)
    with Trace(tmp_path / "drop", K=K, depth_m=DEPTH) as trace:
        box = trace.object("box", mesh=mesh, mask=LABELS, unit_m=0.001)
        box.hypothesis(0, pose())
    problem = problem_of(tmp_path / "drop")
    assert any("its mask is left out: " in note and "holds 3 labels (1, 2, 3)" in note for note in problem.notes)
    write_trace(tmp_path / "right", mesh)
    np.save(tmp_path / "right" / "mask_0.npy", MASK.astype(np.uint8) * 255)
    assert np.array_equal(problem_of(tmp_path / "right").instances[0].mask, MASK)


def test_exr_images_say_what_to_do(made: Made) -> None:
    (path,) = (made.scene / "depth").iterdir()
    path.rename(path.with_suffix(".exr"))
    assert "000003.exr: EXR is not read; save its values by numpy.save as 000003.npy" in refusal(made)
