"""The image pane: which contours there are, where the layers lie, and which numbers the browser gets."""

from __future__ import annotations

import base64
import io
import json
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image as PilImage

from tests.viewer.fake_tools import DRAGGED
from tests.viewer.two_runs import TWO, debugger
from verefine_viz.core.model import Texture
from verefine_viz.core.palette import SIDE_COLORS, STAGE_COLORS
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.image_layers import (
    NO_NUMBER,
    contours_svg,
    map_html,
    model_html,
    numbers_html,
    object_crop,
    photo_html,
    posed_objects,
    shown_contours,
    shown_side,
)
from verefine_viz.viewer.panels.image_panel import pane_html
from verefine_viz.viewer.snapshot.compared_poses import probe
from verefine_viz.viewer.snapshot.snapshot import Snapshot

RUN = c.RunUntil("end")


def keys(view: Snapshot) -> list[str]:
    return [one.key for one in shown_contours(view)]


def labels(view: Snapshot) -> set[str]:
    return {one.label for one in shown_contours(view)}


def test_each_moment_has_the_contours_of_its_poses() -> None:
    view = debugger().view()
    assert keys(view) == ["ground truth", "best"]
    assert labels(view) == {"B ground truth", "A current = answer"}
    view = debugger().carry_out([c.Step()]).view()
    assert keys(view) == ["ground truth", "simulated", "best"]
    assert labels(view) == {"ground truth", "A simulated", "accepted = B refined = answer"}, "one pose, one contour"
    assert {one.key: one.color for one in shown_contours(view)}["simulated"] == STAGE_COLORS["simulated"]
    unknown = replace(view, poses={name: pose for name, pose in view.poses.items() if name != "ground truth"})
    assert keys(unknown) == ["simulated", "best"]
    view = debugger().carry_out([c.StepStage(), c.StepStage()]).view()
    assert "simulated" in keys(view)
    assert not {"refined", "accepted"} & set(keys(view))
    assert labels(debugger().carry_out([RUN]).view()) == {"ground truth", "A initial", "B answer"}
    view = debugger().carry_out([c.Step(), c.EditPose(), DRAGGED]).view()
    assert {"B edited", "A accepted = answer"} <= labels(view)


def test_two_runs_have_their_sides_and_no_stages() -> None:
    debug = debugger().carry_out([RUN, c.CompareRun((("method.name", "pir"),))])
    drawn = shown_contours(debug.view())
    assert [one.key for one in drawn] == ["ground truth", "A", "B"]
    assert [one.color for one in drawn[1:]] == [SIDE_COLORS["A"], SIDE_COLORS["B"]]
    assert [one.dashed for one in drawn] == [False, False, True]
    debug.carry_out([c.ShowSide("B", False)])
    assert keys(debug.view()) == ["ground truth", "A"]
    debug.carry_out([c.StopComparing()])
    assert "A" not in keys(debug.view())


def test_the_whole_scene_has_all_its_objects() -> None:
    view = debugger().carry_out([TWO, RUN, c.ShowScene()]).view()
    drawn = shown_contours(view)
    assert [one.key for one in drawn] == ["ground truth", "A", "B"]
    assert [len(one.poses) for one in drawn] == [2, 2, 2]
    assert view.b is not None
    assert len(posed_objects(view, view.b)) == 2


def test_every_contour_is_in_the_svg_and_in_the_legend() -> None:
    view = debugger().carry_out([c.Step()]).view()
    contours = shown_contours(view)
    svg, pane = contours_svg(view, contours), pane_html(view, contours)
    assert re.findall('data-contour="([^"]+)"', svg) == keys(view) == re.findall('data-key="([^"]+)"', pane)


def test_without_a_photo_the_depth_image_is_shown() -> None:
    observation = replace(debugger().view().problem.observation, rgb=None)
    image = jpeg(photo_html(observation))
    assert image.shape == (60, 80, 3)
    assert np.ptp(image.astype(int), axis=2).max() > 60  # colours, not greys
    photo = np.full((60, 80, 3), (250, 10, 10), np.uint8)
    assert abs(jpeg(photo_html(replace(observation, rgb=photo))).astype(int) - photo).max() < 12


def jpeg(html: str) -> np.ndarray:
    match = re.search('data:image/jpeg;base64,([^"]+)', html)
    return np.asarray(PilImage.open(io.BytesIO(base64.b64decode(match[1]))))


def test_the_browser_has_the_numbers_that_a_click_gives() -> None:
    view = debugger().carry_out([c.Step()]).view()
    side = shown_side(view)
    assert side.maps is not None
    html, photo = numbers_html(side), photo_html(view.problem.observation)
    u0, v0, width, height = json.loads(attribute(html, "area"))
    rendered, difference, angle, classes = unpacked(html, "numbers").reshape(4, height, width)
    (observed,) = unpacked(photo, "depth").reshape(1, 60, 80)
    for v in range(60):
        for u in range(80):
            p = probe(side.maps, view.map_target, u, v)
            assert_same(int(observed[v, u]), p.observed_m, 1e4)
            row, column = v - v0, u - u0
            if not (0 <= row < height and 0 <= column < width):
                assert (p.rendered_m, p.pixel_class) == (None, "not scored")
                continue
            assert_same(int(rendered[row, column]), p.rendered_m, 1e4)
            assert_same(int(difference[row, column]), p.difference_mm, 10)
            assert_same(int(angle[row, column]), p.angle_deg, 10)
            assert (classes[row, column] == 0) == (p.pixel_class == "not scored")


def assert_same(number: int, value: float | None, per_unit: float) -> None:
    assert (number == NO_NUMBER) == (value is None)
    if value is not None:
        assert number == pytest.approx(per_unit * value, abs=0.51)


def attribute(html: str, name: str) -> str:
    match = re.search(f'data-{name}="([^"]+)"', html)
    return match[1]


def unpacked(html: str, name: str) -> np.ndarray:
    return np.frombuffer(zlib.decompress(base64.b64decode(attribute(html, name))), "<i4")


def test_model_and_map_lie_where_the_pose_is_rendered_and_scored() -> None:
    view = debugger().carry_out([c.Step(), c.ShowMap("difference")]).view()
    side = shown_side(view)
    for html, mask in (
        (model_html(view, side), side.maps.rendered_m > 0),
        (map_html(view, side), side.maps.classes > 0),
    ):
        rows, columns = np.nonzero(mask)
        assert f"left:{columns.min()}px;top:{rows.min()}px" in html
        assert f"width:{np.ptp(columns) + 1}px;height:{np.ptp(rows) + 1}px" in html
        match = re.search('data:image/png;base64,([^"]+)', html)
        image = np.asarray(PilImage.open(io.BytesIO(base64.b64decode(match[1]))).convert("RGBA"))
        part = mask[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        assert not image[~part][:, 3].any()


def test_the_crop_is_that_of_the_object_whatever_the_iteration_and_stays_in_the_image() -> None:
    debug = debugger()
    first = object_crop(debug.view())
    assert object_crop(debug.carry_out([RUN]).view()) == first
    rows, columns = np.nonzero(debug.view().target.instance.mask)
    assert 0 <= first.u0 <= columns.min() <= columns.max() < first.u1 <= 80
    assert 0 <= first.v0 <= rows.min() <= rows.max() < first.v1 <= 60


# What is drawn in 3D beside it


def test_hypotheses_vanish_with_the_end_of_the_run_and_come_back_when_asked_for() -> None:
    debug = debugger().carry_out([c.Step()])
    assert "hypotheses" in debug.view().options.layers
    debug.carry_out([RUN])
    assert "hypotheses" not in debug.view().options.layers
    debug.carry_out([c.ShowLayer("hypotheses", True)])
    assert debug.view().is_answer
    assert "hypotheses" in debug.view().options.layers
    debug.carry_out([c.ShowLayer("hypotheses")])
    assert "hypotheses" not in debug.view().options.layers
    debug.carry_out([c.Back()])
    assert "hypotheses" in debug.view().options.layers


def test_a_textured_model_is_shown_with_its_texture() -> None:
    view = debugger().carry_out([RUN]).view()
    side, model = shown_side(view), view.target.model
    assert side is not None
    red = np.full((4, 4, 3), (200, 0, 0), np.uint8)
    skin = Texture(red, np.zeros((len(model.faces), 3, 2), np.float32))
    textured = replace(view, target=replace(view.target, model=replace(model, texture=skin)))
    match = re.search('data:image/png;base64,([^"]+)', model_html(textured, side))
    image = np.asarray(PilImage.open(io.BytesIO(base64.b64decode(match[1]))))
    opaque = image[..., 3] > 0
    assert opaque.any()
    assert (image[opaque][:, 0] > 0).all()
    assert not image[opaque][:, 1:3].any()
    assert not image[~opaque].any()
