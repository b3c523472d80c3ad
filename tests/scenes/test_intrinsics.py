"""What is said about the camera's matrix of an image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes.bop_folder import make
from verefine_viz.scenes.intrinsics import intrinsics_notes

K = np.array([[90.0, 0, 40], [0, 90, 30], [0, 0, 1]])


def with_middle(cx: float, cy: float) -> np.ndarray:
    return K + np.array([[0, 0, cx - 40], [0, 0, cy - 30], [0, 0, 0]])


@pytest.mark.parametrize("middle", [(-1, 30), (80, 30), (40, 60), (30, 412.5)])
def test_a_principal_point_outside_of_the_image_is_named(middle: tuple[float, float]) -> None:
    (said,) = intrinsics_notes(with_middle(*middle), (60, 80))
    assert said.startswith(f"cx, cy of cam_K are {middle[0]:g}, {middle[1]:g} px, outside of the image of 80×60 px;")
    assert said.endswith("check that cam_K belongs to images of this size")


@pytest.mark.parametrize("middle", [(40, 30), (0, 0), (79, 59), (70, 5)])
def test_one_in_the_image_is_not(middle: tuple[float, float]) -> None:
    assert intrinsics_notes(with_middle(*middle), (60, 80)) == ()


def test_the_note_is_one_of_the_frame(tmp_path: Path) -> None:
    def moved(content: dict[str, Any]) -> None:
        content["3"]["cam_K"][2] = 400

    made = make(tmp_path / "boxes")
    made.edit("scene_camera.json", moved)
    assert any("cx, cy of cam_K are 400, " in note for note in made.read().notes)
