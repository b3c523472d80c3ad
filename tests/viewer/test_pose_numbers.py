"""The edited pose: numbers, arrows in 3D and what is edited stay in step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.viewer.client import client, until
from tests.viewer.conftest import OpenPage
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, rotation_of_quat_wxyz, transform
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App
from verefine_viz.viewer.state.edited_pose import displaced, displacement


@pytest.fixture
def app(open_page: OpenPage) -> App:
    app = open_page()
    app.send(c.EditPose())
    app.wait_until_idle()
    return app


def numbers(app: App) -> Any:
    return app.page.layout.physics.numbers


def edited(app: App) -> Float:
    T = app.debugger.options.T_cam_obj_edited
    assert T is not None
    return T


def gizmo(app: App) -> Float:
    handle = app.page.scene._gizmo
    return transform(rotation_of_quat_wxyz(handle.wxyz), handle.position)


def dragged(app: App, T: Float) -> None:
    app.send(c.DragPose(tuple(float(x) for x in T.ravel())))
    app.wait_until_idle()


def test_typed_numbers_move_the_pose_and_the_arrows(app: App) -> None:
    first = edited(app)
    with client(app.url) as browser:
        browser.set(numbers(app).shift, (12.0, 0.0, 0.0))
        until(app, lambda: edited(app)[0, 3] == pytest.approx(first[0, 3] + 0.012))
        browser.set(numbers(app).turn, (0.0, 20.0, 0.0))
        wanted = displaced(first, np.array([12.0, 0, 0]), np.array([0, 20.0, 0]), "camera")
        until(app, lambda: np.allclose(edited(app), wanted, atol=1e-9))
        until(app, lambda: np.allclose(gizmo(app), wanted, atol=1e-6))
    assert numbers(app).shift.value == (12.0, 0.0, 0.0)
    assert numbers(app).turn.value == (0.0, 20.0, 0.0)


def test_a_dragged_pose_is_shown_as_numbers_along_the_chosen_axes(app: App) -> None:
    first = edited(app)
    dragged(app, first @ transform(axis_angle([0, 0, 1], np.deg2rad(30)), [0.01, 0, 0]))
    seen = displacement(first, edited(app), "camera")
    assert numbers(app).shift.value == pytest.approx(seen[0], abs=0.006)
    with client(app.url) as browser:
        browser.set(numbers(app).axes, "object")
        until(app, lambda: numbers(app).shift.value == (10.0, 0.0, 0.0))
    assert numbers(app).turn.value == (0.0, 0.0, 30.0)


def test_what_is_not_typed_keeps_its_hidden_decimals(app: App) -> None:
    first = edited(app)
    dragged(app, displaced(first, np.array([1.23456, 0, 0]), np.array([0, 0, 7.65432]), "camera"))
    assert numbers(app).shift.value == (1.23, 0.0, 0.0)
    with client(app.url) as browser:
        browser.set(numbers(app).shift, (1.23, 5.0, 0.0))
        wanted = displaced(first, np.array([1.23456, 5, 0]), np.array([0, 0, 7.65432]), "camera")
        until(app, lambda: np.allclose(edited(app), wanted, atol=1e-9))


def test_they_are_there_while_a_pose_is_edited_and_begin_at_nothing(app: App) -> None:
    fields = numbers(app).axes, numbers(app).shift, numbers(app).turn
    assert [field.visible for field in fields] == [True] * 3
    dragged(app, displaced(edited(app), np.array([5.0, 0, 0]), np.zeros(3), "camera"))
    assert numbers(app).shift.value == (5.0, 0.0, 0.0)
    app.send(c.EditPose(False))
    app.wait_until_idle()
    assert [field.visible for field in fields] == [False] * 3
    app.send(c.EditPose())
    app.wait_until_idle()
    assert numbers(app).shift.value == (0.0, 0.0, 0.0)
