"""An export goes to the browser that asked for it, and to no other."""

from __future__ import annotations

from typing import Any

import pytest
import viser

from tests.viewer.client import client, until
from verefine_viz.viewer import commands as c
from verefine_viz.viewer import export as downloads
from verefine_viz.viewer.app import App
from verefine_viz.viewer.panels.page_layout import KEYS

Sent = list[tuple[int, str, bytes]]


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> Sent:
    """(client, name, content) of every file that was handed to a browser."""
    found: Sent = []

    def send(self: viser.ClientHandle, filename: str, content: bytes, *_: Any, **__: Any) -> None:
        found.append((self.client_id, filename, content))

    monkeypatch.setattr(viser.ClientHandle, "send_file_download", send)
    return found


def test_the_button_hands_it_to_the_browser_that_was_clicked_in(app: App, sent: Sent) -> None:
    with client(app.url), client(app.url) as second:
        second.set(app.page.layout.session.exports, "Command log")
        until(app, lambda: app.debugger.written)
        asked = max(app.server.get_clients())
    path = app.debugger.written[0].path
    assert sent == [(asked, path.name, path.read_bytes())]
    assert app.debugger.message.startswith(f"Written: {path}; ")


def test_a_command_of_the_palette_hands_it_over_as_well(app: App, sent: Sent) -> None:
    k = next(k for k, (_, _, command) in enumerate(KEYS) if command == c.Export("maps"))
    with client(app.url) as browser:
        browser.trigger(app.page.layout.commands[k])
        until(app, lambda: app.debugger.written)
    path = app.debugger.written[0].path
    assert [(name, content) for _, name, content in sent] == [(path.name, path.read_bytes())]


def test_what_is_too_large_is_only_written_and_said(app: App, sent: Sent, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(downloads, "LARGEST_BYTES", 10)
    with client(app.url) as browser:
        browser.set(app.page.layout.session.exports, "Maps PNG")
        until(app, lambda: app.debugger.written)
    assert sent == []
    assert "too many to download in the browser (at most" in app.debugger.message
    assert app.debugger.written[0].path.exists()


def test_a_script_gets_it_on_disk_only_and_the_log_names_no_browser(app: App, sent: Sent) -> None:
    app.send(c.Export("results", client=7))
    app.send(c.Export("maps"))
    app.wait_until_idle()
    assert sent == []
    assert [kept.note for kept in app.debugger.written] == ["", ""]
    assert app.debugger.log == [c.Export("results"), c.Export("maps")]
