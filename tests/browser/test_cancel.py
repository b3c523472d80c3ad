"""Cancelling what takes long, and pages of other sites: both leave everything as it is."""

from __future__ import annotations

import base64
import http.client
import time

import pytest

from verefine_viz.page.workspace import Workspace


def test_cancel_leaves_everything_as_it_was(show, monkeypatch):
    screen = show()
    for k in (1, 2):
        screen.key("ArrowRight")
        screen.until("state.view.k === arg", k)
    first = screen.app.debugger.space.work.first
    log = list(screen.app.debugger.log)

    def slow(space, branch, settings):
        for i in range(1200):
            space.progress.checkpoint("Decomposing the model of mug.", i / 1200)
            time.sleep(0.05)

    monkeypatch.setattr(Workspace, "restart", slow)
    screen.tab("settings")
    screen.click("Restart")
    screen.text("Decomposing the model of mug.")
    screen.shot("cancel")
    screen.click("Cancel")
    screen.text("Cancelled: everything is as it was before.")
    screen.until("state.busy.text === ''")
    assert screen.app.debugger.space.work.first is first
    assert screen.app.debugger.log == log
    assert screen.state("[state.view.k, state.runs.get(state.view.branch).rows.length]") == [2, 2]


@pytest.mark.parametrize(("origin", "status"), [("http://example.org", 403), ("", 101)])
def test_pages_of_other_sites_are_refused(pages, origin, status):
    app = pages.app()
    connection = http.client.HTTPConnection("127.0.0.1", app.server.port, timeout=10)
    key = base64.b64encode(b"0123456789abcdef").decode()
    upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Key": key, "Sec-WebSocket-Version": "13"}
    connection.request("GET", "/ws", headers={**upgrade, "Origin": origin or app.url})
    assert connection.getresponse().status == status
    connection.close()
