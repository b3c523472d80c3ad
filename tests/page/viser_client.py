"""A browser's websocket without a browser: connects, clicks, changes values, presses hotkeys."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any

import msgpack
import viser
from websockets.sync.client import ClientConnection, connect

SUBPROTOCOL = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, 0.0, 1.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""What a browser sends as soon as it is connected."""


class FakeClient:
    """One connected client; what it sends is what the page's JavaScript would send."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.send(CAMERA)

    def send(self, message: dict[str, Any]) -> None:
        packed = msgpack.packb(message)
        assert packed is not None
        self._socket.send(packed)

    def set(self, handle: Any, value: Any) -> None:
        """Change a widget, or click it with ``value=True``."""
        self.send({"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": {"value": value}})

    def trigger(self, command: Any) -> None:
        """Press a hotkey, or choose a command in the palette."""
        self.send({"type": "CommandTriggerMessage", "uuid": command._impl.uuid})


@contextmanager
def client(url: str, origin: str | None = None):
    """A connected :class:`FakeClient`; ``origin`` as a web page's browser would send it."""
    # Nobody reads what comes: with a limit on what waits, the server's goodbye would wait behind it.
    limits: dict[str, Any] = {"max_size": None, "max_queue": None}
    with connect(url.replace("http", "ws"), subprotocols=[SUBPROTOCOL], origin=origin, **limits) as socket:  # type: ignore[arg-type, list-item]
        yield FakeClient(socket)
