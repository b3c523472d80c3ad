"""The page's server: who may connect, what malformed messages do, and what is served."""

from __future__ import annotations

import json
import logging
import socket
import time
from collections.abc import Iterator
from concurrent.futures import Future
from http.client import HTTPConnection

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from verefine_viz import __version__
from verefine_viz.core.errors import SettingsError, UnavailableError
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.server import MOST_FAULTS, PageServer

ORIGIN = "http://localhost:3000"
RECEIVED: list[tuple[int, object]] = []


def picture(number: int) -> Future[bytes] | None:
    if number > 2:
        return None
    made: Future[bytes] = Future()
    made.set_result(b"" if number == 2 else b"webp")
    return made


def new_server(**given: object) -> PageServer:
    options = {"host": "127.0.0.1", "port": 0, "allowed_origins": [ORIGIN], "blobs": Blobs(), **given}
    server = PageServer(receive=lambda *what: RECEIVED.append(what), thumbnail=picture, **options)  # type: ignore[arg-type]
    server.start()
    return server


@pytest.fixture(scope="module")
def server(processes: None) -> Iterator[PageServer]:
    server = new_server()
    yield server
    server.stop()


def asked(server: PageServer, path: str = "/", **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = HTTPConnection("127.0.0.1", server.port, timeout=20)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    finally:
        connection.close()


def address(server: PageServer) -> str:
    return f"ws://127.0.0.1:{server.port}/ws"


def test_foreign_pages_are_refused_on_http_and_websocket(server: PageServer):
    for origin in ("http://evil.example", "null", "http://localhost:3001", f"https://127.0.0.1:{server.port}"):
        assert asked(server, Origin=origin)[0] == 403, origin
        with pytest.raises(InvalidStatus) as refused:
            connect(address(server), origin=origin)  # type: ignore[arg-type]
        assert refused.value.response.status_code == 403, origin
    for host in ("evil.example", f"evil.example:{server.port}", "127.0.0.1:1"):
        assert asked(server, Host=host)[0] == 403, host
    for origin in (ORIGIN, server.url):
        assert asked(server, Origin=origin)[0] == 200
        with connect(address(server), origin=origin) as window:  # type: ignore[arg-type]
            hello = json.loads(window.recv())
            assert (hello["t"], hello["version"]) == ("hello", __version__)


def test_every_answer_has_a_policy_without_inline_scripts(server: PageServer):
    for path in ("/", "/web/app.js", "/web/nothing.js", "/web/../server.py", "/blob/9"):
        policy = asked(server, path)[1]["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
    assert asked(server, "/web/../server.py")[0] == 404
    for path in ("a", "web/a", "thumb/9", "written/a", "blob/a", "3d/a"):
        assert asked(server, f"/{path * 1000}")[0] in (404, 502), path


def test_malformed_messages_are_noted_and_the_tenth_closes_the_window(
    server: PageServer, caplog: pytest.LogCaptureFixture
):
    RECEIVED.clear()
    with caplog.at_level(logging.WARNING), connect(address(server)) as window, connect(address(server)) as other:
        for k in range(MOST_FAULTS):
            window.send(["{}", b"\x00\xff", '{"verb": "evil"}', '{"verb": "step", "x": 1}', "[" * 9000][k % 5])
            window.send('{"verb": "step", "branch": 3}')
        with pytest.raises(ConnectionClosed):
            while True:
                window.recv(20)
        other.send('{"verb": "pause"}')
        while not any(isinstance(verb, p.Pause) for _, verb in RECEIVED):
            time.sleep(0.01)
    assert sum(isinstance(verb, p.Step) for _, verb in RECEIVED) == MOST_FAULTS - 1
    lines = [record.message for record in caplog.records if record.message.startswith("window")]
    assert len(lines) == MOST_FAULTS + 1
    assert all("\n" not in line for line in lines)


def test_pictures_of_answers(server: PageServer):
    assert asked(server, "/thumb/1")[0::2] == (200, b"webp")
    assert [asked(server, f"/thumb/{k}")[0] for k in ("2", "3", "x", "-1")] == [404] * 4


@pytest.mark.usefixtures("processes")
def test_an_address_that_cannot_be_bound_is_one_clear_line():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen(1)
        port = other.getsockname()[1]
        with pytest.raises(UnavailableError, match=rf"^port {port} on 127\.0\.0\.1 is taken; .*--port N"):
            new_server(port=port)
    with pytest.raises(UnavailableError, match=r"cannot be bound .* usually 127.0.0.1"):
        new_server(host="203.0.113.7")
    with pytest.raises(SettingsError, match="is no origin"):
        new_server(allowed_origins=["localhost:3000"])


@pytest.mark.usefixtures("processes")
def test_stop_frees_the_port():
    first = new_server()
    first.stop()
    again = new_server(port=first.port)
    assert asked(again)[0] == 200
    again.stop()
