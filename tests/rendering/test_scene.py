"""Pictures of whole scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.rendering.witness import CAMERA, T_BOX, T_TABLE, T_TORUS, box, cast, table, torus
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Placed
from verefine_viz.rendering.rendered_scene import GREY, render_scene

PLACED = [Placed(0, torus(), T_TORUS), Placed(4, box(), T_BOX), Placed(2, table(), T_TABLE)]


def test_it_shows_what_ray_casting_shows() -> None:
    picture = render_scene(PLACED, CAMERA)
    depth, normals, labels = cast([(p.model, p.T_cam_obj) for p in PLACED], CAMERA)
    assert (labels == picture.labels).mean() > 0.9999
    same = labels == picture.labels
    assert (np.abs(picture.depth_m - depth)[same] > 1e-4).sum() <= 3
    seen = same & (labels >= 0)
    assert (np.abs(picture.normals_cam - normals)[seen].max(axis=1) > 1e-3).mean() < 0.005


def test_the_order_of_objects_changes_labels_only() -> None:
    forward, backward = render_scene(PLACED, CAMERA), render_scene(PLACED[::-1], CAMERA)
    assert np.array_equal(forward.depth_m, backward.depth_m)
    assert np.array_equal(forward.labels >= 0, backward.labels >= 0)
    assert np.array_equal(forward.labels[forward.labels >= 0], 2 - backward.labels[forward.labels >= 0])


def test_colours_are_blended_between_corners() -> None:
    model = table()
    colors = np.where(model.vertices[:, :1] > 0, [255, 0, 0], [0, 0, 255]).astype(np.uint8)
    painted = replace(model, vertex_colors=colors)
    rgb = render_scene([Placed(0, painted, transform(np.eye(3), [0, 0, 1.2]))], CAMERA).rgb.astype(int)
    row = rgb[CAMERA.height // 2]
    lit = row.sum(axis=1) > 0
    # The light fades towards the sides; the mixture does not know.
    red = row[lit, 0] / row[lit].sum(axis=1)
    expected = np.linspace(red[0], red[-1], len(red))
    assert red[0] < 0.15
    assert red[-1] > 0.85
    assert np.abs(red - expected).max() < 0.01


def test_without_colours_it_is_grey_and_brightest_head_on() -> None:
    rgb = render_scene([Placed(0, table(), transform(np.eye(3), [0, 0, 1.2]))], CAMERA).rgb
    lit = rgb[rgb.any(axis=2)]
    assert (lit == lit[:, :1]).all()
    assert lit.max() == GREY[0]


def test_an_empty_scene_is_empty() -> None:
    picture = render_scene([], CAMERA)
    assert not picture.depth_m.any()
    assert (picture.labels == -1).all()
    behind = render_scene([Placed(0, box(), transform(np.eye(3), [0, 0, -1]))], CAMERA)
    assert not behind.rgb.any()
