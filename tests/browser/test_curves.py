"""The curves name every hypothesis, also where there are many and the object's name is long."""

from __future__ import annotations

from pathlib import Path

from tests.browser.conftest import Look, is_seen, saved
from verefine_viz.viewer import commands as c


def test_ten_hypotheses_are_all_in_the_legend(look: Look, tmp_path: Path) -> None:
    scene = {"source": "demo", "demo": "clutter", "frames": ["0/0"]}
    path = saved(tmp_path, scene=scene, hypotheses={"max_per_object": 10}, method={"name": "rir"})
    screen = look(path)
    screen.app.send(c.RunTo(2))
    screen.at(2)
    screen.curve("Score")
    legend = screen.page.locator(".vz .curves:visible").first
    names = legend.locator(".who>span")
    assert names.all_inner_texts() == ["answer", *(str(k) for k in range(1, 11))]
    assert all(is_seen(screen, name) for name in (names.first, names.last))
    caption = legend.locator(".what")
    assert caption.evaluate("e => e.scrollWidth <= e.clientWidth"), "there is room for the caption as well"
    chart = legend.locator("xpath=ancestor::*[.//*[contains(@class, 'uplot')]][1]").locator(".uplot")
    assert is_seen(screen, chart)
    screen.shot("curves_ten")
