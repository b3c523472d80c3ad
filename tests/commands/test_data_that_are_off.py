"""What people have wrong on disk is named with what would fit, whichever way the frame comes in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.sizes import real, scene
from tests.calibration.ways_in import MISTAKES, WAYS, Frame, frame_of, read, write_bop_folder
from verefine_viz.commands.dataset_check import check_split
from verefine_viz.commands.dataset_parts import CheckRow
from verefine_viz.core.data_remedies import TO_OPENGL
from verefine_viz.core.problem import Problem

pytestmark = pytest.mark.usefixtures("long_run")


def in_8_bits(frame: Frame) -> Frame:
    step_m = 1e-3 * np.ceil(1e3 * frame.depth_m.max() / 255)
    return replace(frame, depth_m=np.round(frame.depth_m / step_m) * step_m)


def normalised(frame: Frame) -> Frame:
    h, w = frame.depth_m.shape
    return replace(frame, K=np.diag([1 / w, 1 / h, 1]) @ frame.K)


OFF: dict[str, tuple[Callable[[Frame], Frame], tuple[str, ...]]] = {
    "mesh × 10": (lambda f: f.times(mesh=10), ("models that are 10 times smaller",)),
    "mesh × 0.1": (lambda f: f.times(mesh=0.1), ("models that are 10 times as large", "0.01 would fit better")),
    "depth × 10": (lambda f: f.times(depth=10), ("depth that is 10 times smaller", "about 0.1 times as much depth")),
    "depth × 0.001": (lambda f: f.times(depth=0.001), ("depth that is 1000 times", "median of ")),
    "K transposed": (lambda f: replace(f, K=f.K.T), ("column by column", "transposed")),
    "K normalised": (normalised, ("normalised",)),
    "255 is background": (lambda f: f.with_objects(lambda o: replace(o, mask=~o.mask)), ("inverted",)),
    "8 bits": (in_8_bits, ("8 bits",)),
    "OpenGL's axes": (lambda f: f.posed(lambda T: TO_OPENGL @ T), ("OpenGL", "OpenCV's axes")),
}
"""What a user has wrong, and what names it in one of these ways; tests/calibration has what else is noticed."""


def right(problem: Problem, first: str = "") -> Frame:
    """The frame with its ground truth as initial poses."""
    return frame_of(problem, 3, first).with_objects(lambda o: replace(o, initial=o.truth))


def checked(root: Path) -> dict[str, CheckRow]:
    return {found.name: found for found in check_split(root, "test").findings}


def said_by(way: str, frame: Frame, root: Path) -> tuple[str, str]:
    """What is noted of a frame, and what is doubted; "check" is what ``datasets check`` says of a BOP folder, by ground
    truth or, without any, by initial poses.
    """
    if way != "check":
        return read(way, frame, root)
    write_bop_folder(frame.with_objects(lambda o: replace(o, initial=o.initial if o.truth is None else None)), root)
    return "", "; ".join(found.advice for found in checked(root).values() if found.advice)


def assert_not_doubted(way: str, frame: Frame, folder: Path) -> None:
    for k, one in enumerate((frame, replace(frame, masks_in_alpha=True), frame.without_truth())):
        assert said_by(way, one, folder / f"{way} {k}")[1] == ""
    if way == "kept frame":
        plausible = checked(folder / f"{way} 2" / "kept")["plausibility"]
        assert plausible.result.startswith("initial poses")
        assert plausible.advice == ""


@pytest.mark.parametrize("way", [*WAYS, "check"])
def test_right_data_are_not_doubted_and_a_mask_may_be_in_the_alpha_channel(way: str, tmp_path: Path) -> None:
    assert_not_doubted(way, right(scene("clutter")), tmp_path)


@pytest.mark.parametrize("name", [*OFF, *MISTAKES])
def test_what_is_off_is_named_by_each_way_in_with_ground_truth_and_without(name: str, tmp_path: Path) -> None:
    change, words = (OFF | MISTAKES)[name]
    wrong = change(right(scene("clutter")))
    for way in [*WAYS, "check"] if name in OFF else WAYS:
        if way == "folder" and name == "masks of all objects":
            continue  # Its single mask may be wide.
        for truth, frame in (("with", wrong), ("without", wrong.without_truth())):
            text = "; ".join(said_by(way, frame, tmp_path / f"{way} {truth}"))
            assert any(one in text for one in words), (way, truth, text)


@pytest.mark.parametrize("way", ["folder", "kept frame", "check"])
def test_of_a_real_frame_what_is_off_is_named_and_right_data_are_not(
    shared_data: Path, way: str, tmp_path: Path
) -> None:
    # A mug looks like no other when it is turned.
    frame = right(real(shared_data / "ycbv", "0/1"), "025_mug")
    assert_not_doubted(way, frame, tmp_path)
    for name, (change, words) in OFF.items():
        text = "; ".join(said_by(way, change(frame), tmp_path / name))
        assert any(one in text for one in words), (name, text)
