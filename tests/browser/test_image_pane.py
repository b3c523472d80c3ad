"""The image pane in a browser: zoom, wipe, legend, maps, and the pixel under the mouse."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.browser.conftest import SESSIONS, SLOW_MS, Look, Screen, until_true
from verefine_viz.core.geometry import apply
from verefine_viz.viewer import commands as c

MUG = SESSIONS / "mug.toml"
SCALE = "+getComputedStyle(document.documentElement).getPropertyValue('--image-scale')"
HIT = (
    "(() => { const b = document.querySelector('.image-hit').getBoundingClientRect(); return [b.x, b.y, b.width]; })()"
)


def test_a_finished_run_is_looked_at(look: Look) -> None:
    screen = look(MUG)
    screen.click("Run")
    screen.finished()
    until_true(screen.page, f"{SCALE} > 1 && document.querySelector('.model img')?.naturalWidth > 0")
    photo_model_and_contours_lie_over_each_other_where_the_camera_has_them(screen)
    the_wipe_has_the_photo_on_its_left_and_the_rendering_on_its_right(screen)
    a_map_lies_over_the_photo_until_none_is_chosen(screen)
    the_pixel_under_the_mouse_has_its_numbers_and_a_cross_on_every_map(screen)
    the_3d_view_goes_to_the_sensor_and_to_the_object(screen)
    a_ruler_goes_from_the_marked_pixel_to_the_next_one_and_the_object_can_be_cut_open(screen)


def test_a_step_leaves_the_zoom_and_the_legend_as_they_are(look: Look) -> None:
    screen = look(MUG)
    for _ in range(3):
        screen.click("Step ▶")
    screen.at(3)
    until_true(screen.page, f"{SCALE} > 1 && document.querySelector('.model img')?.naturalWidth > 0")
    the_wheel_zooms_about_the_mouse_a_drag_moves_and_a_double_click_takes_it_back(screen)
    the_legend_switches_a_contour_off_for_this_browser_and_later_steps(screen)


def middle(screen: Screen) -> tuple[float, float]:
    box = screen.page.locator(".image-view").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def pixel_at(screen: Screen, u: int, v: int) -> tuple[float, float]:
    """Where the middle of a pixel is on the screen."""
    x, y, width = screen.page.evaluate(HIT)
    scale = width / screen.app.debugger.workspace.work.problem.observation.camera.width
    return x + (u + 0.5) * scale, y + (v + 0.5) * scale


def read_out(screen: Screen) -> str:
    until_true(screen.page, "/observed [0-9]/.test(document.querySelector('.image-readout').textContent)")
    return screen.page.locator(".image-readout").inner_text()


def photo_model_and_contours_lie_over_each_other_where_the_camera_has_them(screen: Screen) -> None:
    layers = ".image-layer.photo img, .image-layer.contours svg, .image-hit"
    boxes = f"[...document.querySelectorAll('{layers}')].map(e => e.getBoundingClientRect()).map(b => [b.x, b.width])"
    photo, contours, hit = screen.page.evaluate(boxes)
    assert contours == pytest.approx(photo, abs=0.5)
    assert hit == pytest.approx(photo, abs=0.5)
    drawn = screen.page.evaluate("[...document.querySelectorAll('[data-contour]')].map(e => e.dataset.contour)")
    assert set(drawn) == {"ground truth", "best", "initial"}
    stroke = screen.page.evaluate("getComputedStyle(document.querySelector('.contours use:not(.rim)')).strokeWidth")
    assert float(stroke.removesuffix("px")) * screen.page.evaluate(SCALE) == pytest.approx(2, abs=0.01)
    screen.shot("image_pane")


def the_wheel_zooms_about_the_mouse_a_drag_moves_and_a_double_click_takes_it_back(screen: Screen) -> None:
    page, (x, y) = screen.page, middle(screen)
    before, fitted = page.evaluate(HIT), page.evaluate(SCALE)
    page.mouse.move(x + 40, y)
    page.mouse.wheel(0, -400)
    until_true(page, f"{SCALE} > {1.5 * fitted}")
    after, grown = page.evaluate(HIT), page.evaluate(SCALE) / fitted
    assert after[0] - (x + 40) == pytest.approx((before[0] - (x + 40)) * grown, abs=1)
    # A step changes pictures and contours, and nothing of that.
    screen.click("◀ Back")
    screen.app.wait_until_idle(60)
    assert page.evaluate(HIT) == pytest.approx(after)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 30, y + 10, steps=3)
    page.mouse.up()
    assert page.evaluate(HIT)[:2] == pytest.approx([after[0] + 30, after[1] + 10], abs=1)
    assert screen.app.debugger.options.pixel is None, "the end of a drag is no click"
    page.mouse.dblclick(x, y)
    until_true(page, f"Math.abs({SCALE} - {fitted}) < 1e-6")
    page.locator("[data-image=whole]").click(timeout=SLOW_MS)
    assert page.evaluate(SCALE) < fitted
    page.locator("[data-image=whole]").click(timeout=SLOW_MS)  # The page stays open for the next test.
    assert page.evaluate(SCALE) == pytest.approx(fitted)


def the_wipe_has_the_photo_on_its_left_and_the_rendering_on_its_right(screen: Screen) -> None:
    page, (x, y) = screen.page, middle(screen)
    clip = "getComputedStyle(document.querySelector('.image-layer.model')).clipPath"
    assert page.evaluate(clip) == "none"
    page.locator("[data-image=wipe]").click(timeout=SLOW_MS)
    assert "50%" in page.evaluate(clip)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 60, y, steps=3)
    page.mouse.up()
    share = float(re.findall(r"([0-9.]+)%", page.evaluate(clip))[-1]) / 100
    width = page.locator(".image-view").bounding_box()["width"]
    assert share == pytest.approx(0.5 - 60 / width, abs=0.01)
    screen.shot("image_wipe")
    page.locator("[data-image=wipe]").click(timeout=SLOW_MS)
    assert page.evaluate(clip) == "none"


def the_legend_switches_a_contour_off_for_this_browser_and_later_steps(screen: Screen) -> None:
    page = screen.page
    seen = "getComputedStyle(document.querySelector('[data-contour=\"ground truth\"]')).display !== 'none'"
    assert page.evaluate(seen)
    page.locator(".image-key", has_text="ground truth").click(timeout=SLOW_MS)
    assert not page.evaluate(seen)
    screen.click("◀ Back")
    screen.app.wait_until_idle(60)
    assert not page.evaluate(seen)
    page.locator(".image-key", has_text="ground truth").click(timeout=SLOW_MS)
    assert page.evaluate(seen)


def a_map_lies_over_the_photo_until_none_is_chosen(screen: Screen) -> None:
    page = screen.page
    shown = "getComputedStyle(document.querySelector('.image-layer.map')).display !== 'none'"
    assert not page.evaluate(shown)
    page.locator(".image-map").select_option(label="angle")
    screen.until(lambda: screen.app.debugger.options.map == "angle")
    assert page.evaluate(shown)
    until_true(page, "document.querySelector('.image-map').selectedOptions[0].textContent === 'angle'")
    until_true(page, "document.querySelector('.image-scale')?.textContent.startsWith('B answer: angle')")
    page.locator(".image-map").select_option(label="no map")
    assert not page.evaluate(shown)
    assert screen.app.debugger.options.map == "angle"


def the_pixel_under_the_mouse_has_its_numbers_and_a_cross_on_every_map(screen: Screen) -> None:
    page = screen.page
    mask = screen.app.debugger.view().target.instance.mask
    rows, columns = mask.nonzero()
    wanted = int(columns.mean()) - 8, int(rows.mean()) + 4
    x, y = (int(place) for place in pixel_at(screen, *wanted))  # A click has whole numbers, a mouse may have others.
    page.mouse.move(x, y)
    legend = "document.querySelector('.image-legend').getBoundingClientRect().top"
    before_hover = page.evaluate(legend)
    hovered = read_out(screen)
    assert page.evaluate(legend) == before_hover, "the legend keeps its place"
    u, v = (int(number) for number in hovered.partition(" ·")[0].split(", "))
    assert abs(u - wanted[0]) + abs(v - wanted[1]) <= 2
    until_true(page, "document.querySelectorAll('body > .image-cross').length === 14")
    before = screen.app.debugger.options.pixel
    assert before is None, "hovering asks the program for nothing"
    page.mouse.click(x, y)
    screen.until(lambda: screen.app.debugger.options.pixel == (u, v))
    side = screen.app.debugger.view().b
    assert side is not None
    probe = side.probe
    assert probe is not None
    assert hovered.split(" · ")[1:] == [
        f"observed {probe.observed_m:.4f}",
        f"rendered {probe.rendered_m:.4f} m",
        f"Δ {probe.difference_mm:.1f} mm",
        f"{probe.angle_deg:.1f}°",
        probe.pixel_class,
    ]
    until_true(page, "document.querySelectorAll('.image-view .image-cross').length === 1")
    # From a map to the photo.
    picture: Any = page.locator(".vz.strip img[data-crop]").nth(9)
    picture.hover(timeout=SLOW_MS)
    until_true(page, f"!document.querySelector('.image-readout').textContent.startsWith('{u}, {v} ·')")
    until_true(page, "document.querySelectorAll('body > .image-cross').length === 14")
    page.mouse.move(2, 2)
    until_true(page, "document.querySelectorAll('body > .image-cross').length === 0")


def the_3d_view_goes_to_the_sensor_and_to_the_object(screen: Screen) -> None:
    page, (client,) = screen.page, screen.app.server.get_clients().values()
    problem = screen.app.debugger.workspace.work.problem
    support = problem.observation.support
    assert support is not None
    T_world_cam = support.T_world_cam

    def follows() -> None:
        """The handle has a new camera at once, the browser when the message has arrived. What is set next
        is sent only if it differs from what the browser last reported.
        """
        camera = client.camera
        distance_m = float(((camera.position - camera.look_at) ** 2).sum() ** 0.5)
        until_true(page, f"Math.abs(window.__viserMutable.cameraControl.distance - {distance_m}) < 1e-3")

    page.get_by_title("look through the camera in 3D").click(timeout=SLOW_MS)
    screen.until(lambda: bool(abs(client.camera.position - T_world_cam[:3, 3]).max() < 1e-3))

    def is_along_the_axis() -> bool:
        axis = client.camera.look_at - client.camera.position
        return bool(abs(axis / (axis @ axis) ** 0.5 - T_world_cam[:3, 2]).max() < 1e-3)

    screen.until(is_along_the_axis)
    follows()
    best = screen.app.debugger.view().poses["best"].T_cam_obj
    screen.app.send(c.MoveCamera("object", client.client_id))
    middle_cam = apply(best, problem.targets[0].model.points).mean(axis=0, keepdims=True)
    middle_world = apply(T_world_cam, middle_cam)[0]
    screen.until(lambda: bool(abs(client.camera.look_at - middle_world).max() < 0.03))
    assert 0.05 < ((client.camera.position - client.camera.look_at) ** 2).sum() ** 0.5 < 0.5
    follows()
    screen.key("v")
    first = screen.app.server.initial_camera
    screen.until(lambda: bool(abs(client.camera.position - first.position).max() < 1e-3))
    screen.until(lambda: client.camera.fov == pytest.approx(first.fov, abs=1e-3))
    follows()


def a_ruler_goes_from_the_marked_pixel_to_the_next_one_and_the_object_can_be_cut_open(screen: Screen) -> None:
    page, observation = screen.page, screen.app.debugger.workspace.work.problem.observation
    rows, columns = (observation.depth_m > 0).nonzero()
    first, last = (int(columns[0]), int(rows[0])), (int(columns[-1]), int(rows[-1]))
    screen.app.send(c.ProbePixel(*first))
    screen.app.wait_until_idle(60)
    page.locator(".image-bar button[title^=ruler]").click(timeout=SLOW_MS)
    screen.until(lambda: screen.app.debugger.options.ruler == first)
    screen.app.send(c.ProbePixel(*last))
    screen.app.wait_until_idle(60)
    until_true(page, "/^[0-9.]+ mm, depth/.test(document.querySelector('.image-length')?.textContent)")
    (client,) = screen.app.server.get_clients().values()
    uncut_m = client.camera.near
    screen.tab("View")
    for _ in range(5):
        page.locator("[data-dock-region=right]").get_by_role("slider").first.press("ArrowRight", timeout=SLOW_MS)
    screen.until(lambda: screen.app.debugger.options.cut_percent == 5 and client.camera.near > uncut_m)
    screen.shot("ruler_and_cut")
    screen.key("r")
    until_true(page, "!document.querySelector('.image-length')")
