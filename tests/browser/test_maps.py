"""Score maps: numbers under the mouse, one mark everywhere, large maps, and pairs of poses that exist."""

from __future__ import annotations

import numpy as np
import pytest

from verefine_viz.core.scores import PIXEL_CLASSES

ARRAYS = {
    "rendered": ("rendered_m", 1.0, 4),
    "difference": ("depth_difference_m", 1e3, 1),
    "angle": ("angle_rad", 180 / np.pi, 0),
    "depth fit f_d": ("f_d", 1.0, 2),
    "normal fit f_n": ("f_n", 1.0, 2),
}  # The engine's array, the factor to what is shown, and digits.
REGION = "(await import('/web/sides.js')).sidesOf(moment)"
ALL_DRAWN = f"{REGION}.a?.stale === false && ({REGION}.b === null || {REGION}.b.stale === false)"
CANVASES = "[...document.querySelectorAll('.map-tile canvas, .stage canvas')]"
PIXELS = f"""{CANVASES}.map((canvas) =>
  new Uint32Array(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.buffer))"""
HASHES = f"{PIXELS}.map((pixels) => pixels.reduce((hash, pixel) => Math.imul(hash ^ pixel, 16777619), 0))"
KEEP = f"(window.kept = {PIXELS}).map((pixels, i) => {CANVASES}[i].width + {CANVASES}[i].height)"
CHANGED = f"{PIXELS}.map((pixels, i) => pixels.reduce((n, pixel, k) => n + (pixel !== window.kept[i][k]), 0))"
WAITING = ".map-tile .waiting"
HOLDS_COLOUR = """
  const load = window.fetch;
  window.fetch = async (url, ...given) => {
    const { state } = await import("/web/store.js");
    if (url === `/blob/${state.frame?.smoothed}`) await new Promise((done) => { window.letGo = done; });
    return load(url, ...given);
  };"""


def column(screen, name):
    return screen.page.locator(".map-column").filter(has=screen.page.get_by_role("button", name=name, exact=True))


def point(screen, name, row, pixel):
    """Where a pixel of the image is on the screen in one of the maps."""
    box = column(screen, name).locator("canvas").nth(row).bounding_box()
    regions = np.array(screen.state(f"[{REGION}.a, {REGION}.b].filter(Boolean).map(s => s.region)"))
    low, high = regions[:, :2].min(axis=0), (regions[:, :2] + regions[:, 2:]).max(axis=0)
    scale = min(np.array([box["width"], box["height"]]) / (high - low))
    x, y = scale * (np.array(pixel) + 0.5 - (low + high) / 2)
    return box["x"] + box["width"] / 2 + float(x), box["y"] + box["height"] / 2 + float(y)


def shown(screen, name, letter):
    """What stands below a map of the pixel at the mouse; a dash where there is nothing to say."""
    text = column(screen, name).locator(f".map-foot .of.{letter}").all_inner_texts() or ["–"]
    return text[0].removeprefix("A").removeprefix("B").strip().replace("−", "-")


def test_numbers_under_the_mouse_are_those_of_the_engine(show):
    screen = show().finish()
    screen.until(ALL_DRAWN)
    branch = screen.app.debugger.space.work.first
    target = branch.run.problem.targets[0]
    Ts = {side: np.array(screen.state(f"moment.{side}.T")).reshape(4, 4) for side in "ab"}
    engine = {side: branch.final_evaluator.maps(target, T) for side, T in Ts.items()}
    vs, us = np.nonzero((engine["a"].classes > 0) | (engine["b"].classes > 0))
    for i in np.linspace(0, len(us) - 1, 9).astype(int):
        pixel = (int(us[i]), int(vs[i]))
        screen.page.mouse.move(*point(screen, "difference", i % 2, pixel))
        screen.until("String(state.hover) === String(arg)", pixel)
        u, v = pixel
        for side, maps in engine.items():
            assert shown(screen, "classes", side) == ("–", *PIXEL_CLASSES)[maps.classes[v, u]]
            for name, (array, factor, digits) in ARRAYS.items():
                value = factor * float(getattr(maps, array)[v, u])
                counts = maps.counted[v, u] if name.endswith(("f_d", "f_n")) else value > 0 or name != "rendered"
                if np.isnan(value) or not counts:
                    assert shown(screen, name, side) == "–"
                else:
                    assert float(shown(screen, name, side)) == pytest.approx(value, abs=0.51 * 10**-digits)
    screen.shot("maps_hover")


def test_click_marks_one_pixel_everywhere_until_it_is_unmarked(show):
    screen = show()
    screen.until(ALL_DRAWN)
    u0, v0, u1, v1 = screen.state("moment.object.box")
    pixel = [(u0 + u1) // 2, (v0 + v1) // 2]
    screen.wait(lambda: screen.page.locator(WAITING).count() == 0)
    before = screen.settled(HASHES)  # Outlines come later.
    sizes = screen.state(KEEP)
    screen.page.mouse.click(*point(screen, "angle", 1, pixel))
    screen.until("String(state.view.pixel) === String(arg)", pixel)
    screen.page.mouse.move(640, 20)  # The mouse's own cross is not the mark.
    screen.settled(HASHES)
    for size, changed in zip(sizes, screen.state(CHANGED), strict=True):
        assert 2 * size < changed < 5 * size  # A whole cross is in every picture, its lines 3 pixels wide.
    assert screen.page.locator(".pixel-numbers .at").inner_text() == f"{pixel[0]}, {pixel[1]}"
    screen.shot("maps_mark")
    screen.key("Escape")
    screen.until("state.view.pixel === null")
    assert screen.settled(HASHES) == before
    for marked in (True, False):
        screen.page.mouse.click(*point(screen, "classes", 0, pixel))
        screen.until("(state.view.pixel !== null) === arg", marked)


def test_the_colour_of_the_image_is_drawn_also_when_it_comes_after_all_maps(show):
    screen = show()
    screen.page.add_init_script(HOLDS_COLOUR)
    screen.page.reload()
    screen.until(ALL_DRAWN)
    screen.until("Boolean(window.letGo)")
    tile = column(screen, "image colour").locator(".waiting")
    assert tile.count() == 1
    screen.page.evaluate("window.letGo()")
    screen.wait(lambda: tile.count() == 0)


def test_title_of_a_map_makes_it_large_and_back(show):
    screen = show()
    screen.until(ALL_DRAWN)
    small = column(screen, "angle").locator("canvas").first.bounding_box()
    column(screen, "angle").get_by_role("button").click()
    screen.until("state.view.largeMap === 'angle'")
    assert screen.page.locator(".map-column").count() == 1
    large = column(screen, "angle").locator("canvas").first.bounding_box()
    assert large["width"] * large["height"] > 3 * small["width"] * small["height"]
    screen.shot("maps_large")
    screen.click("All maps")
    screen.until("state.view.largeMap === null")


def test_poses_to_choose_from_exist_and_equal_poses_show_one_row(show):
    screen = show()
    for k in range(4):
        names = screen.state("Object.keys(moment.poses).filter(name => moment.poses[name].T)")
        for select in screen.page.locator(".pane.maps .posed select").all():
            assert select.locator("option").evaluate_all("all => all.map(o => o.value)") == names
        screen.key("ArrowRight")
        screen.until("state.view.k === arg", k + 1)
    screen.view(a="accepted", b=screen.state("moment.row.accepted"))
    screen.text("A and B are the same pose")
    screen.until(ALL_DRAWN)
    assert column(screen, "difference").locator("canvas").count() == 1
    assert screen.page.locator(".pane.maps .posed").count() == 1
    screen.shot("maps_equal")
