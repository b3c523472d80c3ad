"""Opens pages for tests: one of the stand-ins, or of a session and parts of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.viewer.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.viewer import session_page
from verefine_viz.viewer.app import App

SESSION = Session(title="test", method=MethodSettings(iterations=2))
OpenPage = Callable[..., App]


@pytest.fixture
def open_page(tmp_path: Path, processes: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[OpenPage]:
    """Starts pages, which end with the test; nobody watches their animations, so these take no time."""
    monkeypatch.setattr(session_page, "FRAME_S", 0.001)
    running: list[App] = []

    def opened(session: Session = SESSION, tools: type[FakeTools] = FakeTools) -> App:
        app = App(session, port=0, make_tools=tools, folder=tmp_path).start()  # type: ignore[arg-type]
        running.append(app)
        app.wait_until_idle()
        return app

    yield opened
    for app in running:
        app.stop()


@pytest.fixture
def app(open_page: OpenPage) -> App:
    return open_page()
