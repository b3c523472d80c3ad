"""What a learned refiner saw takes the place of the score maps, in every layout and window, and goes again."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.browser.conftest import Look, saved, until_true
from verefine_viz.viewer import commands as c

_FIGURES_SEEN = """n => {
    const strip = document.querySelector('[data-floating-window]:has(.strip)').getBoundingClientRect();
    const figures = [...document.querySelectorAll('.vz .refiner figure')].map(f => f.getBoundingClientRect());
    return figures.length === n
        && figures.every(b => b.width && b.right <= strip.right && b.bottom <= strip.bottom); }"""


@pytest.mark.parametrize(("refiner", "n_figures"), [("depth_net_icp", 4), ("densefusion", 2)])
def test_what_the_refiner_saw_is_shown_where_it_is_a_learned_one(
    look: Look, tmp_path: Path, refiner: str, n_figures: int
) -> None:
    densefusion = {"iterations": 2}
    screen = look(saved(tmp_path, scene={"demo": "mug"}, method={"refiner": refiner}, densefusion=densefusion))
    screen.app.send(c.Step())
    screen.app.wait_until_idle(60)
    box = screen.page.get_by_label("what the refiner saw")
    assert screen.page.locator(".vz .maps").is_visible()
    for width, height in ((1920, 1080), (1280, 640)):
        screen.page.set_viewport_size({"width": width, "height": height})
        for preset in ("inspect", "maps"):
            screen.app.send(c.ShowLayout(preset))
            until_true(screen.page, f"document.documentElement.dataset.preset === '{preset}'")
            box.check(force=True)
            until_true(screen.page, _FIGURES_SEEN, n_figures)
            assert not screen.page.locator(".vz .maps").is_visible()
            screen.shot(f"{refiner}_{preset}_{width}x{height}")
    box.uncheck(force=True)
    assert screen.page.locator(".vz .maps").is_visible()
