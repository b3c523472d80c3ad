"""viser behind the page's server: its page, its websocket, and whom it answers."""

from __future__ import annotations

import gzip
import logging
import threading
import time
from collections.abc import Callable, Iterator
from urllib.request import Request, urlopen

import msgpack
import numpy as np
import pytest
import uvicorn
from starlette.applications import Starlette
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.page.viser_client import CAMERA, SUBPROTOCOL
from verefine_viz.page.proxy import routes
from verefine_viz.page.scene3d.viser_server import MOST_MALFORMED, Viser3DServer


@pytest.fixture(scope="module")
def viser_server(processes: None) -> Iterator[Viser3DServer]:
    server = Viser3DServer()
    yield server
    server.stop()


@pytest.fixture(scope="module")
def page_address(viser_server: Viser3DServer) -> Iterator[str]:
    config = uvicorn.Config(Starlette(routes=routes(viser_server.get_port())), port=0, log_level="warning")
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
    request = Request(f"http://{page_address}/3d/?darkMode", headers={"Accept-Encoding": "gzip"})
    with urlopen(request) as answer:
        page, headers = gzip.decompress(answer.read()), answer.headers
    assert b"<script" in page
    policy = headers["Content-Security-Policy"]
    assert "frame-ancestors 'self'" in policy
    assert "sha256-" in policy
    assert "unsafe-inline'; img" in policy  # styles only


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


def test_foreign_pages_are_refused(viser_server: Viser3DServer) -> None:
    port = viser_server.get_port()
    own = f"127.0.0.1:{port}"
    for origin in ("http://evil.example", "null", f"https://{own}", f"http://evil.example:{port}"):
        with pytest.raises(InvalidStatus) as refusal, opened(own, origin=origin):
            pass
        assert refusal.value.response.status_code == 403, origin
    with pytest.raises(InvalidStatus) as refusal, opened(own, additional_headers={"Host": f"evil.example:{port}"}):
        pass
    assert refusal.value.response.status_code == 403
    for origin in (None, f"http://{own}", f"http://localhost:{port}"):
        with opened(own, origin=origin):
            pass


def test_malformed_messages_end_the_connection(
    viser_server: Viser3DServer, page_address: str, caplog: pytest.LogCaptureFixture
) -> None:
    slider = viser_server.gui.add_slider("s", 0.0, 1.0, 0.1, 0.5)
    bad = [b"\xff", b"", {"type": "NoSuchMessage"}, {"type": "GuiUpdateMessage"}]
    bad += [
        {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": u}
        for u in ({"removed": True}, {"value": "x"})
    ]
    with caplog.at_level(logging.WARNING), opened(f"{page_address}/3d") as socket:
        for k in range(MOST_MALFORMED):
            message = bad[k % len(bad)]
            socket.send(message) if isinstance(message, bytes) else sent(socket, message)
        with pytest.raises(ConnectionClosed):
            while True:
                socket.recv(10)
        assert socket.close_code == 1008
    assert slider.value == 0.5
    assert len([r for r in caplog.records if "malformed" in r.message]) == 1


def test_share_tunnel_is_refused(viser_server: Viser3DServer) -> None:
    assert viser_server.request_share_url() is None
