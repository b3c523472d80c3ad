"""Pages and debuggers on fake parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from tests.page.fake_tools import FakeTools
from tests.received import received
from verefine_viz.core.settings import Session
from verefine_viz.page.app import App
from verefine_viz.page.messages import AnyMessage
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace

SESSION = msgspec.convert({"method": {"name": "rir", "refiner": "identity", "iterations": 3}}, Session)


class Posted(list):
    """The messages that windows get, as a browser reads them; each is one that messages.d.ts declares."""

    def __call__(self, message: AnyMessage, window: int | None) -> None:
        self.append(received(message))

    def of(self, t: str) -> list[dict]:
        """Return the messages of a type."""
        return [message for message in self if message["t"] == t]


@pytest.fixture
def posted() -> Posted:
    return Posted()


@pytest.fixture
def debugger(posted: Posted) -> Debugger:
    return Debugger(Workspace(SESSION, None, FakeTools), posted)


@pytest.fixture
def open_page(tmp_path: Path, processes: None) -> Iterator[Callable[..., App]]:
    """Open pages on a free port; they are closed afterwards."""
    apps: list[App] = []

    def opened(session: Session = SESSION, tools: type[FakeTools] = FakeTools, **given) -> App:
        app = App(session, port=0, make_tools=tools, folder=tmp_path, **given).start()
        apps.append(app)
        app.wait_until_ready(30)
        return app

    yield opened
    for app in apps:
        app.stop()
