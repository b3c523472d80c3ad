"""The page's server: who may connect, and what happens when it cannot listen."""

from __future__ import annotations

import gzip
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
import viser
from websockets.exceptions import InvalidStatus

from tests.viewer.client import client
from verefine_viz.core.errors import UnavailableError
from verefine_viz.viewer.web.server import Server, allowed_origins


@pytest.fixture
def server() -> Iterator[Server]:
    instance = Server(port=0)
    yield instance
    instance.stop()


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "https://127.0.0.1.evil.example", "http://localhost.evil.example:8080", "null", "file://"],
)
def test_foreign_origin_is_refused(server: Server, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refusal, client(server.url, origin):
        pass
    assert refusal.value.response.status_code == 403


@pytest.mark.parametrize("encoding", ["gzip", "identity"])
def test_the_page_begins_with_our_script_and_is_the_library_s_otherwise(server: Server, encoding: str) -> None:
    served = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
    for _ in range(2):
        with urlopen(Request(server.url, headers={"Accept-Encoding": encoding})) as answer:
            body = answer.read()
        assert int(answer.headers.get("Content-Length")) == len(body)
        page = gzip.decompress(body) if encoding == "gzip" else body
        before, head, after = page.partition(b"<head><script>")
        script, end, rest = after.partition(b"</script>")
        assert head
        assert end
        assert before + b"<head>" + rest == served
        assert b"antialias" in script
        assert b"Escape" in script


def test_other_addresses_are_answered_as_before(server: Server) -> None:
    with pytest.raises(HTTPError) as error:
        urlopen(f"{server.url}/no/such/file.html")
    assert error.value.code == 404
    error.value.close()


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_own_page_and_programs_are_served(server: Server, host: str) -> None:
    for origin in (None, f"http://{host}:{server.get_port()}"):
        clicked = threading.Event()
        button = server.gui.add_button("b")
        button.on_click(lambda _, clicked=clicked: clicked.set())
        with client(server.url, origin) as fake:
            fake.set(button, True)
            assert clicked.wait(5)


def test_share_tunnel_is_refused(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    import viser._viser as internals

    asked = threading.Event()
    opened: list[object] = []
    monkeypatch.setattr(internals, "ViserTunnel", lambda *a, **k: opened.append(a))
    refuse = Server.request_share_url

    def seen(self: Server, verbose: bool = True) -> str | None:
        asked.set()
        return refuse(self, verbose)

    monkeypatch.setattr(Server, "request_share_url", seen)
    with client(server.url) as fake:
        fake.send({"type": "ShareUrlRequest"})
        assert asked.wait(5)
    assert server.request_share_url() is None
    assert opened == []


def test_listens_on_loopback_only(server: Server) -> None:
    assert server.get_host() == "127.0.0.1"
    assert server.url == f"http://127.0.0.1:{server.get_port()}"


def test_taken_port_is_one_clear_line() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen(1)
        port = other.getsockname()[1]
        with pytest.raises(
            UnavailableError, match=rf"^port {port} on 127\.0\.0\.1 is taken; .*--port N, or make app PORT=N"
        ) as error:
            Server(port=port)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("host", ["203.0.113.7", "no such host", "not-a-host.invalid"])
def test_host_that_cannot_be_bound_is_one_clear_line(host: str) -> None:
    with pytest.raises(UnavailableError, match=r"cannot be bound .* usually 127.0.0.1") as error:
        Server(host=host, port=0)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("port", [-1, 65536])
def test_impossible_port_is_one_clear_line(port: int) -> None:
    with pytest.raises(UnavailableError, match=f"port {port} does not exist"):
        Server(port=port)


def test_stop_frees_the_port_and_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    first = Server(port=0)
    port = first.get_port()
    first.stop()
    Server(port=port).stop()
    assert capsys.readouterr().out == ""


def test_all_interfaces_still_refuse_foreign_names() -> None:
    _, pattern = allowed_origins("0.0.0.0")
    assert pattern is not None
    assert pattern.fullmatch("http://192.168.1.5:8080")
    assert not pattern.fullmatch("http://evil.example:8080")
