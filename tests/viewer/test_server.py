"""The page's server: who may connect, and what happens when it cannot listen."""

from __future__ import annotations

import gzip
import re
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from email.message import Message
from http.client import HTTPConnection
from pathlib import Path
from urllib.request import Request, urlopen

import pytest
import viser
from websockets.exceptions import InvalidStatus

from tests.viewer.client import client
from verefine_viz.core.errors import UnavailableError
from verefine_viz.viewer.web import server as server_module
from verefine_viz.viewer.web.admission import Admission
from verefine_viz.viewer.web.server import Server
from verefine_viz.viewer.web.viser_internals import lost_style, lost_words


@pytest.fixture(scope="module")
def server(processes: None) -> Iterator[Server]:
    instance = Server(port=0)
    yield instance
    instance.stop()


def test_foreign_origin_is_refused(server: Server) -> None:
    port = server.get_port()
    for origin in (
        "http://evil.example", "https://127.0.0.1.evil.example", "http://localhost.evil.example:8080", "null",
        "file://", "http://localhost:3000", "http://127.0.0.1", f"https://127.0.0.1:{port}",
    ):  # fmt: skip
        with pytest.raises(InvalidStatus) as refusal, client(server.url, origin):
            pass
        assert refusal.value.response.status_code == 403, origin
    assert b"--allow-origin" in (refusal.value.response.body or b"")


def test_the_page_begins_with_our_script_and_is_the_library_s_otherwise(server: Server) -> None:
    served = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
    for encoding in ("gzip", "identity", "gzip", "identity"):
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


def test_own_page_and_programs_are_served(server: Server) -> None:
    for origin in (None, f"http://127.0.0.1:{server.get_port()}", f"http://localhost:{server.get_port()}"):
        clicked = threading.Event()
        button = server.gui.add_button("b")
        button.on_click(lambda _, clicked=clicked: clicked.set())
        with client(server.url, origin) as fake:
            fake.set(button, True)
            assert clicked.wait(5), origin


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


@pytest.mark.usefixtures("processes")
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


@pytest.mark.usefixtures("processes")
def test_host_or_port_that_cannot_be_bound_is_one_clear_line() -> None:
    for host in ("203.0.113.7", "no such host", "not-a-host.invalid"):
        with pytest.raises(UnavailableError, match=r"cannot be bound .* usually 127.0.0.1") as error:
            Server(host=host, port=0)
        assert "\n" not in str(error.value), host
    for port in (-1, 65536):
        with pytest.raises(UnavailableError, match=f"port {port} does not exist"):
            Server(port=port)


@pytest.mark.usefixtures("processes")
def test_stop_frees_the_port_and_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    first = Server(port=0)
    port = first.get_port()
    first.stop()
    Server(port=port).stop()
    assert capsys.readouterr().out == ""


def asked(server: Server, *, path: str = "/", **headers: str) -> tuple[int, Message]:
    """Status and headers of the answer to a request as a browser or a program makes it."""
    connection = HTTPConnection("127.0.0.1", server.get_port(), timeout=20)
    try:
        connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, answer.headers
    finally:
        connection.close()


def test_the_page_is_not_served_under_another_name_or_port(server: Server) -> None:
    port = server.get_port()
    for host in ("evil.example", f"evil.example:{port}", f"127.0.0.1.evil.example:{port}", "127.0.0.1:1"):
        assert asked(server, Host=host)[0] == 403, host


@pytest.mark.usefixtures("processes")
def test_what_is_allowed_may_open_a_websocket_and_is_an_address_of_the_page() -> None:
    server = Server(port=0, allowed_origins=["http://localhost:3000", "https://Viz.Example/"])
    try:
        for origin in ("http://localhost:3000", "https://viz.example", f"http://localhost:{server.get_port()}"):
            with client(server.url, origin):
                pass
        for host, status in (("localhost:3000", 200), ("viz.example", 200), ("other.example", 403)):
            assert asked(server, Host=host)[0] == status
    finally:
        server.stop()


def test_every_answer_forbids_frames_and_has_a_policy(server: Server) -> None:
    cases: tuple[tuple[str, dict[str, str], int], ...] = (
        ("/", {}, 200),
        ("/no/such/file.html", {}, 404),
        ("/../../server.py", {}, 404),
        ("/", {"Host": "evil.example"}, 403),
        ("/", {"Upgrade": "websocket"}, 426),
    )
    for path, headers, status in cases:
        found, answer = asked(server, path=path, **headers)
        assert found == status, (path, headers)
        assert answer["X-Frame-Options"] == "DENY", (path, headers)
        policy = answer["Content-Security-Policy"]
        assert "frame-ancestors 'none'" in policy, (path, headers)
        assert "default-src 'none'" in policy, (path, headers)


def test_the_policy_of_the_page_names_its_scripts(server: Server) -> None:
    _, answer = asked(server)
    rules = dict(rule.split(" ", 1) for rule in answer["Content-Security-Policy"].split("; "))
    assert "'unsafe-inline'" not in rules["script-src"]
    assert "'unsafe-eval'" not in rules["script-src"]
    assert rules["script-src"].count("'sha256-") == 2
    assert "http" not in answer["Content-Security-Policy"]
    # Without it a browser draws models without their textures.
    assert "blob:" in rules["connect-src"]


def test_no_html_of_ours_carries_a_handler_which_the_policy_would_forbid() -> None:
    for path in Path(server_module.__file__).parents[1].rglob("*.[ph][yt]*"):
        assert not re.search(r"\son[a-z]+=\\?[\"'{]", path.read_text(encoding="utf-8")), path


def unguarded(admission: object, picture: object) -> AbstractContextManager[None]:
    """As if viser had its server from somewhere else than where ours is put."""
    return nullcontext()


class Elsewhere(Admission):
    """Refuses foreign pages, but not under a foreign name."""

    def admits(self, port: int, hosts: Sequence[str], origins: Sequence[str]) -> bool:
        return super().admits(port, [f"127.0.0.1:{port}"], origins) or origins == [f"http://{hosts[0]}"]


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(("part", "other"), [("_served_our_way", unguarded), ("Admission", Elsewhere)])
def test_a_server_that_answers_other_sites_pages_does_not_serve(
    part: str, other: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, part, other)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with pytest.raises(UnavailableError, match=r"it would answer other sites' pages .*pip install 'viser") as error:
        Server(port=port)
    assert "\n" not in str(error.value)
    monkeypatch.undo()
    Server(port=port).stop()  # The port is free again.


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("host", ["0.0.0.0", "::", "::1"])
def test_the_address_of_a_server_reaches_it(host: str) -> None:
    try:
        server = Server(host=host, port=0)
    except UnavailableError as error:
        pytest.skip(str(error)) if ":" in host else pytest.fail(str(error))
    try:
        with urlopen(server.url) as answer:
            assert answer.status == 200
        with client(server.url, server.url):
            pass
    finally:
        server.stop()


def test_it_says_how_to_get_a_program_that_this_page_finds() -> None:
    assert "view …; this page" in lost_words(8080), "where the program listens by itself"
    assert "view … --port 8123; this page" in lost_words(8123)


def test_the_words_are_one_css_string() -> None:
    assert not set(lost_words(8123)) & set('"\\\n')
    assert f'content:"{lost_words(8123)}"' in lost_style(8123)
