"""Pictures of answers: the right part of the image, contours where the object is."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as PilImage

from verefine_viz.core.camera import Camera
from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.core.problem import Target
from verefine_viz.pictures.answer_pictures import HEIGHT_PX, WIDTH_PX, ShownPart, thumbnail, window_around
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.demo import demo_problem

SESSION = resolve({})


@pytest.fixture(scope="module")
def target(processes: None) -> Target:
    return demo_problem("mug", SESSION.scene, SESSION.hypotheses).targets[0]


def image_of(webp: bytes) -> np.ndarray:
    return np.asarray(PilImage.open(io.BytesIO(webp)).convert("RGB")).astype(int)


def near(image: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    return abs(image - np.array(color)).sum(axis=2) < 120


@given(
    st.floats(0, 500), st.floats(0, 300), st.floats(48, 640), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)
)  # fmt: skip
def test_the_windows_camera_sees_what_is_cut_out(u0: float, v0: float, width: float, x: float, y: float) -> None:
    whole = Camera(np.array([[600.0, 0, 320], [0, 610.0, 240], [0, 0, 1]]), 640, 480)
    window = ShownPart(u0, v0, width, width * HEIGHT_PX / WIDTH_PX)
    u, v = whole.project(np.array([x, y, 1.0]))
    scale = WIDTH_PX / width
    # Edges of pixels scale, and their centres lie half a pixel further.
    expected = (u + 0.5 - u0) * scale - 0.5, (v + 0.5 - v0) * scale - 0.5
    assert window.camera(whole).project(np.array([x, y, 1.0])) == pytest.approx(expected, abs=1e-6)


def test_the_window_holds_the_object_and_stays_in_the_image(target: Target) -> None:
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None
    away = np.array(T_gt)
    away[0, 3] += 5.0
    camera = target.observation.camera
    for poses in ([], [T_gt], [T_gt, away]):
        window = window_around(target, poses)
        u0, v0, u1, v1 = window.box
        assert min(u0, v0) >= 0
        assert max(u1 - camera.width, v1 - camera.height) <= 1e-9
        assert window.width / window.height == pytest.approx(WIDTH_PX / HEIGHT_PX)
    rows, columns = np.nonzero(target.instance.mask)
    u0, v0, u1, v1 = window_around(target, [T_gt]).box
    assert u0 <= columns.min() <= columns.max() < u1
    assert v0 <= rows.min() <= rows.max() < v1


def test_answer_and_truth_are_drawn_in_their_colours(target: Target) -> None:
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None
    moved = np.array(T_gt)
    moved[0, 3] += 0.03
    image = image_of(thumbnail(target, moved, WIDTH_PX))
    assert near(image, STAGE_COLORS["accepted"]).sum() > 100
    assert near(image, STAGE_COLORS["ground truth"]).sum() > 100
    alone = image_of(thumbnail(target, None, WIDTH_PX))
    assert near(alone, STAGE_COLORS["accepted"]).sum() < 20


def test_without_colour_truth_or_answer_there_is_still_a_picture(target: Target) -> None:
    bare = Target(
        replace(target.observation, rgb=None), replace(target.instance, T_cam_obj_gt=None, hypotheses=()), target.model
    )
    assert image_of(thumbnail(bare, None, 320)).shape == (240, 320, 3)
