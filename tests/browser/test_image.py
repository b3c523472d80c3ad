"""The image: zoom, wipe, opacity, blink, numbers, ruler and outlines."""

from __future__ import annotations

import numpy as np
import pytest

FITS = "[null, 'image'].includes(state.view.zoom ?? null)"
PICTURE = "document.querySelector('.stage canvas').toDataURL()"


def box_of(screen):
    return screen.page.locator(".stage canvas").bounding_box()


def to_pixel(screen, pixel):
    """Move the mouse to a pixel of the image, which is shown as a whole."""
    box, camera = box_of(screen), screen.state("state.frame.camera")
    scale = min(box["width"] / camera["w"], box["height"] / camera["h"])
    x = box["x"] + (box["width"] - scale * camera["w"]) / 2 + scale * (pixel[0] + 0.5)
    y = box["y"] + (box["height"] - scale * camera["h"]) / 2 + scale * (pixel[1] + 0.5)
    screen.page.mouse.move(x, y)
    screen.until("String(state.hover) === String(arg)", pixel)
    return x, y


def changes(screen, do):
    """Whether something changes the picture, soon."""
    before = screen.page.evaluate(PICTURE)
    do()
    for _ in range(60):
        if screen.page.evaluate(PICTURE) != before:
            return True
        screen.page.wait_for_timeout(50)
    return False


def test_wheel_zooms_where_the_mouse_is_and_a_double_click_fits(show):
    screen = show().finish()
    screen.page.locator(".film").wait_for()  # It comes with the verdict, and takes some height of the image.
    box = box_of(screen)
    x, y = box["x"] + 0.3 * box["width"], box["y"] + 0.6 * box["height"]
    screen.page.mouse.move(x, y)
    screen.until("state.hover")
    under = screen.state("state.hover")
    for _ in range(4):
        screen.page.mouse.wheel(0, -200)
    assert screen.settled("state.view.zoom")["share"] > 3  # Turns of the wheel arrive late.
    screen.page.mouse.move(x + 1, y)
    screen.page.mouse.move(x, y)
    assert screen.state("state.hover") == pytest.approx(under, abs=1)
    screen.shot("image_zoom")
    screen.drag((x, y), (60, -40))
    screen.page.mouse.move(x + 61, y - 40)
    screen.page.mouse.move(x + 60, y - 40)
    assert screen.state("state.hover") == pytest.approx(under, abs=1)
    assert screen.state("state.view.pixel") is None  # A drag marks nothing.
    screen.page.mouse.dblclick(x, y)
    screen.until(FITS)
    screen.page.mouse.dblclick(x, y)
    screen.until(FITS)
    assert screen.state("state.view.pixel") is None


def test_wipe_opacity_and_blink_show_the_model_over_the_photo(show):
    screen = show().finish()
    tools = screen.page.locator(".pane.image .tools")
    assert changes(screen, lambda: tools.locator("select").first.select_option("shaded"))
    opacity = tools.locator("input[type=range]")
    assert changes(screen, lambda: opacity.fill("0.2"))
    tools.locator("select").last.select_option("photo")
    box = box_of(screen)
    screen.drag((box["x"] + box["width"] / 2, box["y"] + box["height"] / 2), (0.1 * box["width"], 0))
    assert screen.state("state.view.layers.at") == pytest.approx(0.6, abs=0.01)
    names = screen.page.locator(".wiped").inner_text().split("\n")
    assert names == ["photo", "shaded model"]
    screen.shot("image_wipe")
    tools.locator("select").last.select_option("off")
    screen.page.keyboard.down("v")
    for shown in ("a", "b", "photo", "a"):
        screen.until("state.view.layers.blink === arg", shown)
    screen.page.keyboard.up("v")
    screen.until("state.view.layers.blink === null")


def test_numbers_and_ruler_are_those_of_the_depth_image(show):
    screen = show().finish()
    screen.view(zoom="image")
    observation = screen.app.debugger.space.problem.observation
    depth_m, K = observation.depth_m, observation.camera.K
    vs, us = np.nonzero(depth_m > 0)
    for i in (len(us) // 5, len(us) // 2):
        u, v = int(us[i]), int(vs[i])
        to_pixel(screen, [u, v])
        assert screen.page.locator(".pixel-numbers").get_by_text(f"{depth_m[v, u]:.4f} m").count() == 1
        seen = screen.page.locator(".pixel-numbers").get_by_text(" ".join(str(c) for c in observation.rgb[v, u]))
        assert seen.count() == 1
    ends = [(int(us[i]), int(vs[i])) for i in (len(us) // 5, len(us) // 2)]
    x, y = to_pixel(screen, ends[0])
    screen.page.keyboard.down("Shift")
    screen.page.mouse.down()
    screen.page.mouse.move(x + 5, y)
    to_pixel(screen, ends[1])
    screen.page.mouse.up()
    screen.page.keyboard.up("Shift")
    assert screen.state("state.view.ruler") == [list(end) for end in ends]
    points = [np.linalg.solve(K, (u, v, 1.0)) * depth_m[v, u] for u, v in ends]
    text = screen.state("(await import('/web/drawing.js')).rulerText(state.view.ruler)")
    assert float(text.split(" mm")[0]) == pytest.approx(1e3 * np.linalg.norm(points[1] - points[0]), abs=0.06)
    screen.shot("image_ruler")


def test_legend_hides_and_shows_outlines(show):
    screen = show().finish()
    legend = screen.page.locator(".legend button")
    assert legend.count() >= 3
    for button in legend.all():
        assert changes(screen, lambda button=button: button.click()), button.inner_text()
