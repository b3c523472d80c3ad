"""Size and place of a mask over its model are found from what is seen of its outline."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.fakes import box_model
from verefine_viz.calibration.outlines import OutlineFit, fit_outline
from verefine_viz.core.arrays import Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Placed
from verefine_viz.rendering.rendered_scene import render_scene

BOX = box_model()
T_CAM_BOX = transform(axis_angle([1.0, 2.0, 0.5], 0.7), [0.05, -0.03, 0.5])
NOTHING = np.zeros((240, 320), np.bool_)


def camera(factor: float = 1.0, dx: float = 0.0, dy: float = 0.0, wide: float = 1.0) -> Camera:
    K = [[300 * factor * wide, 0, 159.5 + dx], [0, 300 * factor, 119.5 + dy], [0, 0, 1]]
    return Camera(np.array(K), 320, 240)


def seen(by: Camera) -> tuple[Mask, NDArray[np.floating]]:
    depth_m = render_scene([Placed(0, BOX, T_CAM_BOX)], by).depth_m
    return depth_m > 0, np.where(depth_m > 0, depth_m, 0.8).astype(np.float32)


def fitted(mask: Mask, depth_m: NDArray[np.floating], others: Mask = NOTHING) -> OutlineFit:
    found = fit_outline(BOX, T_CAM_BOX, camera(), mask, others, depth_m.astype(np.float32))
    assert found is not None
    return found


@settings(max_examples=40)
@given(factor=st.floats(0.6, 1.6), dx=st.floats(-30, 30), dy=st.floats(-30, 30))
def test_factor_and_shift_are_those_of_the_camera_that_took_the_image(factor: float, dx: float, dy: float) -> None:
    found = fitted(*seen(camera(factor, dx, dy)))
    assert found.factor == pytest.approx(factor, rel=0.015)
    centre = np.array([159.5, 119.5])
    np.testing.assert_allclose(found.shift_px, (factor - 1) * (found.drawn.middle_px - centre) + [dx, dy], atol=1.0)
    assert found.depth == pytest.approx(1.0, abs=0.01)
    assert found.error < 0.04


@settings(max_examples=40)
@given(factor=st.floats(0.8, 1.25), wide=st.floats(0.75, 1.3), dx=st.floats(-20, 20))
def test_width_and_height_are_those_of_the_camera_that_took_the_image(factor: float, wide: float, dx: float) -> None:
    found = fitted(*seen(camera(factor, dx, 0.0, wide)))
    assert found.sides == pytest.approx([factor * wide, factor], rel=0.02)
    assert found.sides_error < 0.05


def test_depth_tells_a_displaced_camera_from_a_displaced_mask() -> None:
    mask, depth_m = seen(camera(1.0, 40.0))
    assert fitted(mask, depth_m).gain > 0.2
    in_place = seen(camera())[1]
    assert fitted(mask, in_place).gain < -0.2
    assert fitted(*seen(camera())).gain == pytest.approx(0.0, abs=0.02)


def test_what_hides_a_part_changes_nothing() -> None:
    for factor in (0.8, 1.0, 1.25):
        mask, depth_m = seen(camera(factor))
        columns = np.flatnonzero(mask.any(axis=0))
        hiding = np.zeros_like(mask)
        hiding[:, : int(np.quantile(columns, 0.3))] = True
        # By its depth where nobody knows that it is there, by its mask where it touches the object.
        for others, front_m in ((NOTHING, 0.2), (hiding, 0.5)):
            found = fitted(mask & ~hiding, np.where(hiding, front_m, depth_m), others)
            assert found.factor == pytest.approx(factor, rel=0.02), factor


def test_the_border_of_the_image_is_no_outline() -> None:
    moved = camera(1.2, 95.0)
    mask, depth_m = seen(moved)
    assert mask[:, -1].any()
    assert fitted(mask, depth_m).factor == pytest.approx(1.2, rel=0.02)


def test_measured_depth_is_compared_where_the_object_is_seen() -> None:
    mask, depth_m = seen(camera(1.3, -40.0))
    assert fitted(mask, 0.9 * depth_m).depth == pytest.approx(0.9, abs=0.01)
    assert np.isnan(fitted(mask, np.zeros_like(depth_m)).depth)
    noise = np.random.default_rng(0).uniform(0.3, 0.7, depth_m.shape)
    assert np.isnan(fitted(mask, np.where(mask, noise, depth_m)).depth)


def test_a_mask_of_another_shape_makes_the_factor_uncertain() -> None:
    mask, depth_m = seen(camera())
    rows, columns = np.nonzero(mask)
    around = np.zeros_like(mask)
    around[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
    assert fitted(around, depth_m).error > 5 * fitted(mask, depth_m).error


def test_without_an_outline_nothing_is_said() -> None:
    mask, depth_m = seen(camera())
    few = np.zeros_like(mask)
    few[100:103, 100:103] = True
    behind = transform(np.eye(3), [0.0, 0.0, -0.5])
    plain = depth_m.astype(np.float32)
    assert fit_outline(BOX, T_CAM_BOX, camera(), NOTHING, NOTHING, plain) is None
    assert fit_outline(BOX, T_CAM_BOX, camera(), few, NOTHING, plain) is None
    assert fit_outline(BOX, T_CAM_BOX, camera(), ~NOTHING, NOTHING, np.full_like(plain, 0.8)) is None
    assert fit_outline(BOX, behind, camera(), mask, NOTHING, plain) is None
