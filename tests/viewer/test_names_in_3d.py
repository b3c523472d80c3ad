"""The name of the object in focus stands out in 3D; the others are smaller, so that they do not hide each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.viewer.client import until
from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.app import App


@pytest.mark.usefixtures("processes")
def test_the_name_in_focus_is_the_largest(tmp_path: Path) -> None:
    app = App(Session(method=MethodSettings(iterations=1)), port=0, make_tools=FakeTools, folder=tmp_path).start()
    try:
        app.wait_until_idle()
        for focus in (0, 1):
            app.send(c.OpenFrame("0/2"))
            app.send(c.Focus(focus))
            until(app, lambda focus=focus: _largest(app) == [focus])
    finally:
        app.stop()


def _largest(app: App) -> list[int]:
    """instance_ids of the largest names."""
    assert app.page.scene._others is not None
    sizes = {k: nodes.label.font_screen_scale for k, nodes in app.page.scene._others._nodes.items()}
    return [k for k, size in sizes.items() if size == max(sizes.values())]
