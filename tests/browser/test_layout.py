"""In windows of any size and in every layout nothing covers anything, and pictures are large."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from tests.browser.conftest import SESSIONS, Look, Screen, is_seen, saved, until_true
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.web.viser_internals import SMALL_WINDOW

WINDOWS = ((1920, 1080), (1280, 640))
SMALLEST_MAP_PX = {
    "inspect": {640: 90, 1080: 190},
    "maps": {640: 230, 1080: 445},
    "compare": {640: 90, 1080: 190},
}
"""By layout and height of the window: side of a map."""
_BOXES = """() => {
    const boxes = {}, add = (name, element) => {
        if (!element || getComputedStyle(element).visibility === 'hidden') return;
        const b = element.getBoundingClientRect();
        if (b.width && b.height && b.x < innerWidth) boxes[name] = [b.x, b.y, b.right, b.bottom];
    };
    const pane = mark => document.querySelector(`[data-floating-window]:has(${mark})`);
    add('image', pane('.image-pane')); add('3D head', pane('.scene-pane')); add('maps', pane('.strip'));
    add('timeline', pane('.line')); add('curves', pane('.curves, .objects'));
    add('3D', document.querySelector('canvas[data-engine]')); add('verdict', document.querySelector('.vz.verdict'));
    add('right column', document.querySelector('[data-dock-region=right]'));
    return boxes;
}"""
_TILES = """() => [...document.querySelectorAll('.vz .map:not(.observed) .tile')].map(t => t.getBoundingClientRect())
    .filter(b => b.width).map(b => Math.min(b.width, b.height))"""
_ALL_MAPS_SEEN = """() => {
    const strip = document.querySelector('[data-floating-window]:has(.strip)').getBoundingClientRect();
    return [...document.querySelectorAll('.vz .map .tile')].map(t => t.getBoundingClientRect())
        .filter(b => b.width).every(b => b.right <= strip.right && b.bottom <= strip.bottom); }"""


def boxes_of(screen: Screen) -> dict[str, list[float]]:
    """(left, top, right, bottom) of every part of the page that is seen [px]."""
    return screen.page.evaluate(_BOXES)


def faults(screen: Screen) -> list[str]:
    """Which parts lie over each other or beyond the window."""
    size, boxes = screen.page.viewport_size, boxes_of(screen)
    found = []
    for name, (left, top, right, bottom) in boxes.items():
        if left < -1 or top < -1 or right > size["width"] + 1 or bottom > size["height"] + 1:
            found.append(f"{name} is beyond the window")
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        if min(a[2], b[2]) - max(a[0], b[0]) > 1 and min(a[3], b[3]) - max(a[1], b[1]) > 1:
            found.append(f"{one} lies over {other}")
    return found


def has_come_to_rest(screen: Screen) -> bool:
    """Whether the canvas, whose size follows its cell, has that size."""
    return not faults(screen)


@pytest.mark.parametrize("session", ["mug", "clutter"])
def test_in_every_layout_and_window_nothing_covers_anything_and_all_is_seen(look: Look, session: str) -> None:
    screen = look(SESSIONS / f"{session}.toml")
    screen.app.send(c.Step())
    for width, height in WINDOWS:
        screen.page.set_viewport_size({"width": width, "height": height})
        for preset in sorted(set(get_args(c.Preset)) - {"gallery"}):
            screen.app.send(c.ShowLayout(preset))
            until_true(screen.page, f"document.documentElement.dataset.preset === '{preset}'")
            screen.app.wait_until_idle(60)
            for _ in range(50):
                if has_come_to_rest(screen):
                    break
                screen.page.wait_for_timeout(100)
            assert faults(screen) == [], f"{preset} at {width}×{height}"
            tiles = screen.page.evaluate(_TILES)
            assert min(tiles) >= SMALLEST_MAP_PX[preset][height], f"{preset} at {width}×{height}"
            assert screen.page.evaluate(_ALL_MAPS_SEEN), f"{preset} at {width}×{height}"
            names = screen.page.locator(".vz .map .name:visible").all_inner_texts()
            assert {"rendered", "Δdepth", "angle", "f_d", "f_n", "classes"} <= set(names)
            shown = boxes_of(screen).keys() & {"image", "3D"}
            assert shown == (set() if preset == "maps" else {"image", "3D"})
            screen.shot(f"layout_{session}_{preset}_{width}x{height}")
    assert not screen.page.get_by_text(SMALL_WINDOW).is_visible()
    screen.app.send(c.ShowLayout("inspect"))
    screen.app.send(c.RunUntil("end"))
    screen.app.wait_until_idle(240)
    assert is_seen(screen, screen.page.locator(".vz .bar").last), "the whole score"
    screen.shot(f"smallest_{session}")


def test_a_pane_is_enlarged_and_goes_back_and_a_window_below_the_smallest_says_what_to_do(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    before = boxes_of(screen)
    for mark, name, other in ((".image-pane", "image", "3D"), (".scene-pane", "3D", "image")):
        head = screen.page.locator(f"[data-floating-window]:has({mark}) [data-dock-strip]")
        head.dblclick(position={"x": 200, "y": 10})
        screen.until(lambda name=name: screen.app.debugger.options.enlarged == name)
        screen.page.wait_for_timeout(300)
        now = boxes_of(screen)
        assert {other, "maps"}.isdisjoint(now)
        assert now[name][2] - now[name][0] > 1.9 * (before[name][2] - before[name][0])
        assert faults(screen) == []
        head.dblclick(position={"x": 200, "y": 10})
        screen.until(lambda: screen.app.debugger.options.enlarged is None)
    for expected in ("image", "3D", None):
        screen.key("z")
        screen.until(lambda expected=expected: screen.app.debugger.options.enlarged == expected)
    screen.page.wait_for_timeout(300)
    now = boxes_of(screen)
    assert now.keys() == before.keys()
    for name, box in before.items():
        assert now[name] == pytest.approx(box, abs=1), f"{name}: a canvas has whole pixels, its cell has not"
    line = screen.page.get_by_text(SMALL_WINDOW)
    for size in ({"width": 1024, "height": 640}, {"width": 1280, "height": 600}):  # Small, or zoomed in.
        screen.page.set_viewport_size(size)
        line.wait_for()
        screen.page.set_viewport_size({"width": 1280, "height": 640})
        line.wait_for(state="hidden")


def test_maps_are_enlarged_parted_and_compared(look: Look) -> None:
    screen = look(SESSIONS / "mug.toml")
    screen.app.send(c.Step())
    screen.app.wait_until_idle(60)  # Until then tiles are drawn again.
    the_wheel_enlarges_all_maps_about_the_same_pixel(screen)
    screen.app.send(c.ShowLayout("maps"))
    until_true(screen.page, "document.documentElement.dataset.preset === 'maps'")
    screen.app.wait_until_idle(60)
    screen.page.locator(".vz .map.difference img").last.hover()
    screen.page.get_by_text(re.compile("^[0-9]+, [0-9]+ · observed [0-9]")).locator("visible=true").wait_for()
    a_line_parts_a_from_b_in_the_maps_layout(screen)
    opened = "[data-dock-region=right] [data-dock-tab][aria-selected=true]"
    screen.page.locator(".presets button", has_text="Compare").click()
    screen.page.locator(opened, has_text="A/B").wait_for()
    screen.app.wait_until_idle(60)
    screen.page.locator(".vz .map.difference img").first.click()
    screen.page.locator(opened, has_text="Score").wait_for()
    screen.until(lambda: screen.app.debugger.options.pixel is not None)


def the_wheel_enlarges_all_maps_about_the_same_pixel(screen: Screen) -> None:
    tile = screen.page.locator(".vz .map.difference .tile").first
    tile.wait_for()
    box = tile.bounding_box()
    screen.page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + 0.25 * box["height"])
    screen.page.mouse.wheel(0, -100)
    shares = """() => [...document.querySelectorAll('.vz .map:not(.observed) .tile')].map(t => {
        const a = t.getBoundingClientRect(), b = t.firstElementChild.getBoundingClientRect();
        return [(a.x - b.x) / b.width, (a.y - b.y) / b.height, a.width / b.width];})"""
    until_true(screen.page, f"() => ({shares})().every(s => s[2] < 0.9)")
    left, top, share = np.array(screen.page.evaluate(shares)).T
    assert np.allclose(share, 0.8, atol=0.01)
    assert np.allclose(left + 0.75 * share, 0.75, atol=0.01)
    assert np.allclose(top + 0.25 * share, 0.25, atol=0.01)
    tile.dblclick()
    until_true(screen.page, f"() => ({shares})().every(s => s[2] > 0.99)")


def a_line_parts_a_from_b_in_the_maps_layout(screen: Screen) -> None:
    ends = screen.page.locator(".vz.maps-wipe > span").all_inner_texts()
    assert ends == ["all B", "all A"]
    for share in (0, 0.25, 1):
        screen.page.get_by_label("A or B", exact=True).fill(f"{100 * share:.0f}")
        # Left and right of the line, in the middle of a map: of which pose the picture is.
        seen = screen.page.evaluate(
            """() => { const b = document.querySelector('.vz .map.difference .tile').getBoundingClientRect();
            return [0.2, 0.3].map(x => document.elementFromPoint(b.x + x * b.width, b.y + b.height / 2).alt); }"""
        )
        assert [alt.split(" of ")[1] for alt in seen] == [["refined", "simulated"][x < share] for x in (0.2, 0.3)]
    assert faults(screen) == []


def test_tabs_of_what_is_not_there_are_faint_and_say_why(look: Look, tmp_path: Path) -> None:
    screen = look(saved(tmp_path, scene={"demo": "mug"}, hypotheses={"max_per_object": 1}, method={"name": "pir"}))
    state = """name => { const tab = [...document.querySelectorAll('[data-dock-region=right] [data-dock-tab]')]
        .find(tab => tab.textContent === name); return [+getComputedStyle(tab).opacity < 0.4, tab.title]; }"""
    assert screen.page.evaluate(state, "Score") == [False, "Score"]
    assert screen.page.evaluate(state, "Bandit") == [True, "PIR works on one hypothesis: nothing to choose."]
    assert screen.page.evaluate(state, "Order") == [True, "One object: nothing to order."]
    assert screen.page.evaluate(state, "Landscape") == [True, "Shown when the run is over."]
    screen.click("Run")
    screen.finished()
    until_true(screen.page, f"({state})('Landscape')[1] === 'Landscape'")


def test_in_the_smallest_window_every_class_and_scale_has_its_words_where_colour_counts(
    look: Look, tmp_path: Path
) -> None:
    session = saved(tmp_path, scene={"demo": "clutter"}, score={"colour_weight": 0.1}, method={"name": "pir"})
    screen = look(session)
    screen.page.set_viewport_size({"width": 1280, "height": 640})
    screen.app.send(c.Step())
    for layout in ("inspect", "maps"):
        screen.app.send(c.ShowLayout(layout))
        until_true(screen.page, f"document.documentElement.dataset.preset === '{layout}'")
        screen.app.wait_until_idle(60)
        assert screen.page.locator(".vz .maps.coloured").count() == 1
        words = [*screen.page.locator(".vz .maps .key > span").all(), *screen.page.locator(".vz .maps .side").all()]
        assert words
        for word in words:
            assert is_seen(screen, word), f"{layout}: {word.inner_text()}"
        screen.shot(f"coloured_{layout}")
    assert is_seen(screen, screen.page.locator(".vz .map.observed .ticks"))
