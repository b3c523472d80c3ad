"""What browsers send that is not what viser's page sends: left out, said once, and no traceback."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgpack
import pytest
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import ClientConnection, connect

from tests.viewer.client import CAMERA, SUBPROTOCOL, FakeClient
from verefine_viz.viewer.web.client_messages import MOST_MALFORMED
from verefine_viz.viewer.web.server import Server


class Widgets:
    """A server with one widget of each kind, and a button that says when what was sent before it is through."""

    def __init__(self) -> None:
        self.server = Server(port=0)
        gui = self.server.gui
        self.kinds: dict[str, Any] = {
            "number": gui.add_number("a", 1),
            "fraction": gui.add_number("b", 1.0),
            "slider": gui.add_slider("c", 0, 9, 1, 3),
            "vector": gui.add_vector3("d", (0.0, 1.0, 2.0)),
            "text": gui.add_text("e", "abc"),
            "checkbox": gui.add_checkbox("f", False),
            "dropdown": gui.add_dropdown("g", ("one", "two")),
            "group": gui.add_button_group("h", ("one", "two")),
        }
        self.changes: list[str] = []
        for name, widget in self.kinds.items():
            change = widget.on_click if name == "group" else widget.on_update
            change(lambda _, name=name: self.changes.append(name))
        self._last = gui.add_button("last")
        self._through = threading.Event()
        self._last.on_click(lambda _: self._through.set())

    def change(self, name: str, value: object) -> dict[str, Any]:
        """The message that gives a widget a value."""
        uuid = self.kinds[name]._impl.uuid
        return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}

    def until_through(self, browser: FakeClient) -> None:
        self._through.clear()
        browser.set(self._last, True)
        assert self._through.wait(20)


@pytest.fixture(scope="module")
def widgets(processes: None) -> Iterator[Widgets]:
    made = Widgets()
    yield made
    made.server.stop()


@contextmanager
def connected(widgets: Widgets) -> Iterator[tuple[ClientConnection, FakeClient]]:
    url = widgets.server.url.replace("http", "ws")
    with connect(url, subprotocols=[SUBPROTOCOL], max_size=None, max_queue=None) as socket:  # type: ignore[arg-type, list-item]
        yield socket, FakeClient(socket)


Message = Callable[[Widgets], bytes | str]


def packed(message: object) -> Message:
    return lambda _: msgpack.packb(message)  # type: ignore[return-value]


def given(name: str, value: object) -> Message:
    return lambda widgets: msgpack.packb(widgets.change(name, value))  # type: ignore[return-value]


def setting(**updates: object) -> Message:
    return lambda widgets: msgpack.packb({**widgets.change("number", 0), "updates": updates})  # type: ignore[return-value]


MALFORMED: dict[str, Message] = {
    "text": lambda _: "text",
    "nothing": lambda _: b"",
    "no msgpack": lambda _: b"\xc1",
    "nested": lambda _: b"\x91" * 100_000,
    "a list": packed([1]),
    "no type": packed({}),
    "another type": packed({"type": "Nope"}),
    "a type that is a number": packed({"type": 5}),
    "fields missing": packed({"type": "GuiUpdateMessage"}),
    "a field more": packed({**CAMERA, "more": 1}),
    "a shorter tuple": packed({**CAMERA, "position": (0.0, 1.0)}),
    "text for a number": packed({**CAMERA, "fov": "wide"}),
    "another property": setting(removed=True),
    "no property": setting(),
    "number: none": given("number", None),
    "number: nan": given("number", float("nan")),
    "number: infinite": given("fraction", float("inf")),
    "number: text": given("fraction", "1"),
    "number: true": given("slider", True),
    "number: beyond 64 bits": given("number", 1e308),
    "vector: too short": given("vector", [1.0]),
    "vector: nan": given("vector", [0.0, 1.0, float("nan")]),
    "text: bytes": given("text", b"abc"),
    "checkbox: a list": given("checkbox", [1]),
    "dropdown: a number": given("dropdown", 1),
    "group: none": given("group", None),
}


def test_a_malformed_message_is_left_out_and_said_in_one_line(
    widgets: Widgets, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    widgets.changes.clear()
    values = {name: widget.value for name, widget in widgets.kinds.items()}
    for kind, message in MALFORMED.items():
        caplog.clear()
        with connected(widgets) as (socket, client), caplog.at_level(logging.WARNING):
            for _ in range(2):
                socket.send(message(widgets))
            widgets.until_through(client)
        assert [record.levelname for record in caplog.records] == ["WARNING"], kind
        said = caplog.messages[0]
        assert said.startswith("a browser at 127.0.0.1 sent a message that cannot be read ("), kind
        assert "\n" not in said, kind
        assert caplog.records[0].exc_info is None, kind
        assert widgets.changes == [], kind
        assert {name: widget.value for name, widget in widgets.kinds.items()} == values, kind
    assert capfd.readouterr() == ("", "")


def test_after_ten_the_browser_is_disconnected_and_others_are_not(
    widgets: Widgets, caplog: pytest.LogCaptureFixture
) -> None:
    for kind in ("no msgpack", "number: nan"):
        caplog.clear()
        with connected(widgets) as (socket, _), connected(widgets) as (other, client):
            with pytest.raises(ConnectionClosedError) as end:
                for _ in range(MOST_MALFORMED):  # The server may close before the last call returns.
                    socket.send(MALFORMED[kind](widgets))
                while True:
                    socket.recv(timeout=20)
            assert (end.value.rcvd.code, end.value.rcvd.reason) == (1008, "10 malformed messages"), kind
            other.send(MALFORMED[kind](widgets))  # Counted for itself.
            widgets.until_through(client)
        assert len(caplog.records) == 2, kind


def test_a_choice_that_is_no_longer_there_is_left_out_without_a_word(
    widgets: Widgets, caplog: pytest.LogCaptureFixture
) -> None:
    widgets.changes.clear()
    with connected(widgets) as (_, client):
        for _ in range(MOST_MALFORMED + 1):
            client.send(widgets.change("dropdown", "three"))
            client.send(widgets.change("group", "three"))
        widgets.until_through(client)
    assert widgets.changes == []
    assert caplog.records == []


def test_what_a_page_sends_arrives(widgets: Widgets, caplog: pytest.LogCaptureFixture) -> None:
    sent: tuple[tuple[str, object, object], ...] = (
        ("number", 2, 2),
        ("number", 2.5, 2),
        ("fraction", 2, 2.0),
        ("slider", 7, 7),
        ("vector", [1, 2.5, 3], (1.0, 2.5, 3.0)),
        ("text", "", ""),
        ("checkbox", True, True),
        ("dropdown", "two", "two"),
        ("group", "two", "two"),
    )
    with connected(widgets) as (_, client):
        for name, value, becomes in sent:
            client.send(widgets.change(name, value))
            widgets.until_through(client)
            assert widgets.kinds[name].value == becomes, (name, value)
    assert caplog.records == []
