"""The page's server: who may connect, what malformed messages do, and what is served."""

from __future__ import annotations

import json
import logging
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from http.client import HTTPConnection
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen

import msgpack
import numpy as np
import pytest
import uvicorn
from starlette.applications import Starlette
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.page.viser_client import CAMERA, SUBPROTOCOL, client
from verefine_viz import __version__
from verefine_viz.core.errors import SettingsError, UnavailableError
from verefine_viz.page import protocol as p
from verefine_viz.page.app import App
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.proxy import routes
from verefine_viz.page.scene3d import viser_page
from verefine_viz.page.scene3d import viser_server as viser_module
from verefine_viz.page.scene3d.viser_server import Viser3DServer
from verefine_viz.page.server import MOST_FAULTS, MOST_THREADS, PageServer

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
        assert asked(server, f"/{path * 1000}")[0] == 404, path
    for folder in ("", "web/", "thumb/", "file/", "blob/"):
        for name in ("9" * 300, "9" * 5000, "%00", "%ff"):
            assert asked(server, f"/{folder}{name}")[0] == 404, (folder, name)


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


# viser behind the page's server: its page, its websocket, and whom it answers.


@pytest.fixture(scope="module")
def viser_server(processes: None) -> Iterator[Viser3DServer]:
    server = Viser3DServer()
    yield server
    server.stop()


@pytest.fixture(scope="module")
def page_address(viser_server: Viser3DServer) -> Iterator[str]:
    config = uvicorn.Config(
        Starlette(routes=routes(*viser_page.served(), viser_server.address)), port=0, log_level="warning"
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield f"127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    server.should_exit = True
    thread.join()


def opened(address: str, **options: object) -> Connection:
    return connect(f"ws://{address}", subprotocols=[SUBPROTOCOL], max_size=None, max_queue=None, **options)  # type: ignore[arg-type, list-item]


def sent(socket: Connection, message: object) -> None:
    packed = msgpack.packb(message)
    assert packed is not None
    socket.send(packed)


def arrived(socket: Connection, needle: bytes) -> bool:
    end = time.monotonic() + 10
    while time.monotonic() < end:
        if needle in socket.recv(10):  # type: ignore[operator]
            return True
    return False


def test_the_page_of_viser_comes_with_its_policy(page_address: str) -> None:
    with urlopen(f"http://{page_address}/3d/?darkMode") as answer:
        page, headers = answer.read(), answer.headers
    assert b"<script" in page
    policy = headers["Content-Security-Policy"]
    assert "frame-ancestors 'self'" in policy
    assert "sha256-" in policy
    assert "unsafe-inline'; img" in policy  # styles only


def test_names_that_no_file_of_viser_has_are_not_asked_for(page_address: str) -> None:
    for name in ("x" * 300, "x" * 5000, "a/" * 3000, "%00", "%ff", "a%20b", "nothing.js"):
        with pytest.raises(HTTPError) as answer:
            urlopen(f"http://{page_address}/3d/{name}")
        answer.value.close()
        assert answer.value.code == 404, name


def test_threads_stay_few_however_many_windows_there_are(open_page: Callable[..., App]) -> None:
    app = open_page()

    def load() -> None:
        for path in ("/", "/web/store.js", "/3d/"):
            with urlopen(app.url + path) as answer:
                answer.read()

    before = {*threading.enumerate()}
    loading = [threading.Thread(target=load) for _ in range(20)]
    for thread in loading:
        thread.start()
    for thread in loading:
        thread.join()
    with ExitStack() as stack:
        clients = [stack.enter_context(client(f"{app.url}/3d", app.url)) for _ in range(12)]
        for window in clients:
            for _ in range(3):
                window.send(CAMERA)
    names = [thread.name for thread in threading.enumerate() if thread not in before]
    assert 0 < sum(name.startswith("AnyIO") for name in names) <= MOST_THREADS
    assert 0 < sum(name.startswith("ThreadPoolExecutor") for name in names) <= viser_module.MOST_THREADS


def test_messages_pass_both_ways(viser_server: Viser3DServer, page_address: str) -> None:
    clicked = threading.Event()
    button = viser_server.gui.add_button("b")
    button.on_click(lambda _: clicked.set())
    for number, path in enumerate(("/3d", "/3d/")):
        clicked.clear()
        with opened(page_address + path) as socket:
            assert socket.subprotocol == SUBPROTOCOL
            sent(socket, CAMERA)
            sent(socket, {"type": "GuiUpdateMessage", "uuid": button._impl.uuid, "updates": {"value": True}})
            assert clicked.wait(5)
            points = np.random.default_rng(number).random((1000, 3), np.float32)
            viser_server.scene.add_point_cloud("/cloud", points, (0, 0, 0), precision="float32")
            assert arrived(socket, points.tobytes())


def test_either_side_closes_the_other(viser_server: Viser3DServer, page_address: str) -> None:
    wait_for(lambda: not viser_server.get_clients())
    with opened(f"{page_address}/3d") as socket:
        sent(socket, CAMERA)
        wait_for(lambda: viser_server.get_clients())
    wait_for(lambda: not viser_server.get_clients())
    # viser refuses a page of another version; the proxy hands its code on.
    with connect(f"ws://{page_address}/3d", subprotocols=["viser-v0.0.1"]) as socket:  # type: ignore[list-item]
        with pytest.raises(ConnectionClosed):
            socket.recv(10)
        assert socket.close_code == 1002


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_the_port_answers_the_proxy_alone(viser_server: Viser3DServer) -> None:
    own, _, path = viser_server.address.removeprefix("ws://").partition("/")
    for other in ("", path[:-1], path.swapcase(), f"{path}/", f"{path}?a", f"x/{path}"):
        with pytest.raises(InvalidStatus) as refusal, opened(f"{own}/{other}"):
            pass
        assert refusal.value.response.status_code == 403, other
        with pytest.raises(HTTPError) as answer:
            urlopen(f"http://{own}/{other}")
        answer.value.close()
        assert answer.value.code == 403, other
    with opened(f"{own}/{path}"):
        pass


DRAG = {"type": "TransformControlsUpdateMessage", "name": "/handles", "wxyz": (1.0, 0.0, 0.0, 0.0)}
GARBAGE: tuple[Any, ...] = (
    "text", b"", b"\xff", b"\x81", [1, 2], 7, {"type": "NoSuchMessage"}, {"type": ["a"]}, {"no": "type"},
    {"type": "GuiUpdateMessage"}, {"type": "SceneClickMessage", "x": 1}, {**CAMERA, "more": 1},
    {**CAMERA, "fov": "wide"}, {**CAMERA, "position": "abc"}, {**DRAG, "position": (1.0,)},
    {**DRAG, "position": ("a", "b", "c")}, {**DRAG, "position": {"x": 1}},
)  # fmt: skip
"""No messages; messages of no kind, or without a field; values that are none."""


@pytest.mark.filterwarnings("ignore:.*does not match annotation")
def test_malformed_messages_leave_viser_and_other_windows_as_they_are(
    viser_server: Viser3DServer, page_address: str, caplog: pytest.LogCaptureFixture
) -> None:
    moved: list[object] = []
    handles = viser_server.scene.add_transform_controls("/handles")
    handles.on_update(lambda event: moved.__setitem__(slice(None), [tuple(event.target.position)]))
    with caplog.at_level(logging.CRITICAL), opened(f"{page_address}/3d") as other:
        sent(other, CAMERA)
        owner = {"owner": viser_server.scene._owner_id}
        for garbage in GARBAGE:
            message = {**garbage, **owner} if isinstance(garbage, dict) and "name" in garbage else garbage
            with opened(f"{page_address}/3d") as socket, suppress(ConnectionClosed):
                socket.send(message) if isinstance(message, str | bytes) else sent(socket, message)
                sent(socket, CAMERA)
                socket.ping().wait(5)
        drag = {**DRAG, **owner, "position": (1.0, 2.0, 3.0)}
        sent(other, drag)
        wait_for(lambda: moved == [(1, 2, 3)])
        points = np.random.default_rng(5).random((100, 3), np.float32)
        viser_server.scene.add_point_cloud("/cloud", points, (0, 0, 0), precision="float32")
        assert arrived(other, points.tobytes())


def test_share_tunnel_is_refused(viser_server: Viser3DServer) -> None:
    assert viser_server.request_share_url() is None
