"""What people have wrong on disk is named with what would fit, whichever way the frame comes in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from tests.calibration.sizes import real, scene
from tests.calibration.ways_in import MISTAKES, WAYS, Frame, doubted, frame_of, read, write_bop_folder
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.core.data_remedies import TO_OPENGL
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.scenes.image_files import read_mask

pytestmark = pytest.mark.usefixtures("long_run")
YCBV = Path(__file__).resolve().parents[3] / "shared" / "data" / "ycbv"


def checked(frame: Frame, root: Path) -> str:
    """What ``datasets check`` says of a BOP folder with ground truth."""
    write_bop_folder(frame.with_objects(lambda o: replace(o, initial=None)), root)
    return "; ".join(found.advice for found in check_split(root, "test").findings if found.advice)


def in_8_bits(frame: Frame) -> Frame:
    step_m = 1e-3 * np.ceil(1e3 * frame.depth_m.max() / 255)
    return replace(frame, depth_m=np.round(frame.depth_m / step_m) * step_m)


OFF: dict[str, tuple[Callable[[Frame], Frame], str, str]] = {
    "mesh × 10": (lambda f: f.times(mesh=10), "models that are 10 times smaller", "folder,kept frame,check"),
    "depth × 10": (lambda f: f.times(depth=10), "depth that is 10 times smaller", "folder,check"),
    "K transposed": (lambda f: replace(f, K=f.K.T), "written column by column", "folder,kept frame,check"),
    "K normalised": (
        lambda f: replace(f, K=np.diag([1 / f.depth_m.shape[1], 1 / f.depth_m.shape[0], 1]) @ f.K),
        "it looks normalised",
        "folder,kept frame,check",
    ),
    "255 is background": (
        lambda f: replace(f, objects=tuple(replace(o, mask=~o.mask) for o in f.objects)),
        "inverted",
        "folder,kept frame,check",
    ),
    "8 bits": (in_8_bits, "as if it was stored in 8 bits", "folder,kept frame,check"),
    "OpenGL's axes": (lambda f: f.posed(lambda T: TO_OPENGL @ T), "OpenGL", "folder,check"),
    "OpenGL's axes, kept": (lambda f: f.posed(lambda T: TO_OPENGL @ T), "expected OpenCV's axes", "kept frame"),
    "depth × 10, kept": (lambda f: f.times(depth=10), "about 0.1 times as much depth would fit", "kept frame"),
    "depth × 0.001, kept": (lambda f: f.times(depth=0.001), "depth_m has a median of 0.000", "kept frame"),
    "mesh in cm, kept": (lambda f: f.times(mesh=0.1), "unit_m = 0.001 was given, 0.01 would fit better", "kept frame"),
}
"""What a user has wrong, what is put into words, and by which ways in; tests/calibration has what else is noticed."""
CASES = [(name, way) for name, (_, _, ways) in OFF.items() for way in ways.split(",")]


def right(problem: Problem, first: str = "") -> Frame:
    """The frame with its ground truth as initial poses."""
    return frame_of(problem, 3, first).with_objects(lambda o: replace(o, initial=o.truth))


def frames() -> list[Frame]:
    """A built-in frame, and a real one where the data are there; a mug looks like no other when it is turned."""
    return [right(scene("clutter")), *([right(real(YCBV, "0/1"), "025_mug")] if YCBV.is_dir() else [])]


def said_by(way: str, frame: Frame, root: Path) -> str:
    return checked(frame, root) if way == "check" else doubted(way, frame, root)


@pytest.mark.parametrize("way", [*WAYS, "check"])
def test_right_data_are_not_doubted_and_a_mask_may_be_in_the_alpha_channel(way: str, tmp_path: Path) -> None:
    for k, frame in enumerate(frames()):
        assert said_by(way, frame, tmp_path / str(k)) == ""
        assert said_by(way, replace(frame, masks_in_alpha=True), tmp_path / f"{k} alpha") == ""
        if way != "check":
            assert said_by(way, frame.without_truth(), tmp_path / f"{k} without") == ""


@pytest.mark.parametrize(("name", "way"), CASES)
def test_what_is_off_is_named_with_what_would_fit(name: str, way: str, tmp_path: Path) -> None:
    spoil, words, _ = OFF[name]
    for k, frame in enumerate(frames()):
        assert words in said_by(way, spoil(frame), tmp_path / str(k))


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named_by_each_way_in_with_ground_truth_and_without(name: str, tmp_path: Path) -> None:
    change, words = MISTAKES[name]
    wrong = change(right(scene("clutter")))
    for way in WAYS:
        if way == "folder" and name == "masks of all objects":
            continue  # Its single mask may be wide.
        for truth, frame in (("with", wrong), ("without", wrong.without_truth())):
            text = "; ".join(read(way, frame, tmp_path / f"{way} {truth}"))
            assert any(one in text for one in words), (way, truth, text)


def test_labels_of_several_objects_are_no_mask(tmp_path: Path) -> None:
    masks = [one.mask for one in right(scene("clutter")).objects]
    labels = np.sum([k * mask for k, mask in enumerate(masks, 1)], axis=0, dtype=np.uint8)
    shape = masks[0].shape
    Image.fromarray(labels).save(tmp_path / "labels.png")
    with pytest.raises(InputError, match=r"holds 3 labels \(1, 2, 3\), expected the pixels of one object"):
        read_mask(tmp_path / "labels.png", shape)
    one = (labels == 2).astype(np.uint8)
    grey = ndimage.gaussian_filter(255.0 * one, 1).astype(np.uint8)
    for k, mask in enumerate((one, 255 * one, grey)):
        Image.fromarray(mask).save(tmp_path / f"{k}.png")
        assert read_mask(tmp_path / f"{k}.png", shape).any()
