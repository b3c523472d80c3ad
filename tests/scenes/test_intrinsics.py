"""What is said about the camera's matrix of an image."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes.bop_folder import make, refusal
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.files import decoded_json
from verefine_viz.evaluation.results_scores import evaluate_files
from verefine_viz.scenes.image_files import CameraEntry, intrinsics_notes, intrinsics_of

K = np.array([[90.0, 0, 40], [0, 90, 30], [0, 0, 1]])


def with_middle(cx: float, cy: float) -> np.ndarray:
    return K + np.array([[0, 0, cx - 40], [0, 0, cy - 30], [0, 0, 0]])


def test_a_principal_point_outside_of_the_image_is_named() -> None:
    for middle in ((-1, 30), (80, 30), (40, 60), (30, 412.5)):
        (said,) = intrinsics_notes(with_middle(*middle), (60, 80))
        assert said.startswith(f"cx, cy of cam_K are {middle[0]:g}, {middle[1]:g} px, outside of the image of 80×60 px")
        assert said.endswith("check that cam_K belongs to images of this size")
    for middle in ((40, 30), (0, 0), (79, 59), (70, 5)):
        assert intrinsics_notes(with_middle(*middle), (60, 80)) == ()


def test_the_note_is_one_of_the_frame(tmp_path: Path) -> None:
    def moved(content: dict[str, Any]) -> None:
        content["3"]["cam_K"][2] = 400

    made = make(tmp_path / "boxes")
    made.edit("scene_camera.json", moved)
    assert any("cx, cy of cam_K are 400, " in note for note in made.read().notes)


NO_CAMERA: tuple[tuple[int, float, str], ...] = (
    (0, 1e99, "focal lengths 1e+99, 90; expected positive pixels, 1 to 1e+06"),
    (4, 0.5, "focal lengths 90, 0.5; expected positive pixels, 1 to 1e+06"),
    (4, -90, "focal lengths 90, -90; expected positive pixels, 1 to 1e+06"),
    (2, 1e7, "the principal point 1e+07, 30; expected pixels within ±1e+06"),
    (5, -1e30, "the principal point 40, -1e+30; expected pixels within ±1e+06"),
    (1, 1e30, "a skew of 1e+30, 0; expected pixels within ±1e+06"),
    (3, 1e30, "a skew of 0, 1e+30; expected pixels within ±1e+06"),
)
"""A number of cam_K by its place, another value of it, and what is said."""


def numbers_with(k: int, value: float) -> list[float]:
    numbers = K.ravel().tolist()
    numbers[k] = value
    return numbers


def test_a_matrix_that_no_camera_has_is_refused() -> None:
    for k, value, words in NO_CAMERA:
        with pytest.raises(InputError, match=re.escape(f"here: cam_K has {words}")):
            intrinsics_of(CameraEntry(np.array(numbers_with(k, value)).reshape(3, 3)), "here")
        with pytest.raises(ShapeError, match=re.escape(words)):
            Camera(np.array(numbers_with(k, value)).reshape(3, 3), 80, 60)


def test_such_a_matrix_is_refused_where_a_frame_is_read_or_scored(tmp_path: Path) -> None:
    k, value, words = NO_CAMERA[0]
    made = make(tmp_path / "boxes")
    made.edit("scene_camera.json", lambda content: content["3"].update(cam_K=numbers_with(k, value)))
    assert words in refusal(made)
    (tmp_path / "r.csv").write_text("7,3,5,1,1 0 0 0 1 0 0 0 1,0 0 500,-1\n")
    with pytest.raises(InputError, match=re.escape(words)):
        evaluate_files([tmp_path / "r.csv"], made.root)


def test_the_bounds_of_depth_scale() -> None:
    for scale in (1e-6, 1e4):
        assert decoded_json(b'{"depth_scale": %r}' % scale, CameraEntry).depth_scale == scale
    for scale in (9e-7, 1.1e4):
        with pytest.raises(ValueError, match=r"Expected `float` [<>]= .* \(at \$\.depth_scale\)$"):
            decoded_json(b'{"depth_scale": %r}' % scale, CameraEntry)
