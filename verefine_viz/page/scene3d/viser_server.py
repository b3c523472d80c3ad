"""viser's server for the 3D view, on a loopback port of its own that answers this machine's programs and its own page.

viser has no options for whom it answers, for headers and scripts of its page, for messages that it cannot read, or for
how many threads it keeps: its web server and its pool are wrapped while it starts. It has no option to hide its panel
and its notifications either: ``before_viser.js`` does. The page reads three private parts of viser's client in the
browser: the number of pictures drawn, which nodes there are (``web/scene.js``), and the camera, which a press beside a
handle holds (``web/gizmo_guard.js``). Written for viser 1.1.1; ``tests/browser/test_scene_pane.py`` fails where they
move.
"""

from __future__ import annotations

import base64
import contextlib
import gzip
import hashlib
import io
import logging
import re
import secrets
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from http import HTTPStatus
from pathlib import Path
from typing import Any

import msgspec
import viser
import viser._viser
import websockets.asyncio.server
from viser._messages import GuiUpdateMessage, Message
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from verefine_viz.rendering.gl_context import SOFTWARE

_LOG = logging.getLogger(__name__)
_CONSTRUCTION = threading.Lock()
MOST_THREADS = 2
"""Threads for callbacks, which are short; viser keeps up to 32 for good."""
MOST_MALFORMED = 10
"""So many malformed messages and a client is disconnected."""
_LARGEST_NUMBER = 2**53
"""Browsers count no further."""
_POLICY_VIOLATION = 1008
_NONCE = secrets.token_urlsafe(16)
_BEFORE = (
    (Path(__file__).parent / "before_viser.js")
    .read_text(encoding="utf-8")
    .replace("NONCE", _NONCE)
    .replace("SOFTWARE_RENDERERS", "|".join(SOFTWARE))
)


class Viser3DServer(viser.ViserServer):
    """A viser server on a free loopback port; browsers reach it through the page's proxy.

    No share tunnel is opened, and requests with a foreign Host or Origin are answered by 403.
    """

    def __init__(self) -> None:
        # viser prints a banner whatever it is asked.
        with _CONSTRUCTION, _guarded(self), contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host="127.0.0.1", port=0, verbose=False)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse the tunnel that would put the view on the internet at any client's request."""
        _LOG.warning("a client asked for a public share tunnel; refused")
        return None

    def stop(self) -> None:
        """Close all connections and free the port."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


@contextlib.contextmanager
def _guarded(server: viser.ViserServer) -> Iterator[None]:
    original = websockets.asyncio.server.serve

    def serve(*args: Any, process_request: Any, **kwargs: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            if not admits(connection.local_address[1], request):
                return connection.respond(HTTPStatus.FORBIDDEN, "foreign Host or Origin\n")
            return process_request(connection, request)

        def connection_of(*args: Any, **kwargs: Any) -> ServerConnection:
            return CheckedConnection(server, *args, **kwargs)

        ours = {"process_request": answer, "process_response": secured, "create_connection": connection_of}
        return original(*args, **{**kwargs, **ours})

    websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]
    viser._viser.ThreadPoolExecutor = lambda max_workers: ThreadPoolExecutor(MOST_THREADS)  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = original  # type: ignore[misc]
        viser._viser.ThreadPoolExecutor = ThreadPoolExecutor  # type: ignore[misc]


def admits(port: int, request: Request) -> bool:
    """Return whether a request names this machine as its Host, and comes from no other site's page."""
    names = [f"{name}:{port}" for name in ("127.0.0.1", "localhost")]
    hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
    return len(hosts) == 1 and hosts[0] in names and all(o in [f"http://{name}" for name in names] for o in origins)


def secured(connection: ServerConnection, request: Request, response: Response) -> None:
    """Put our script before viser's page, and say what may run in it and who may frame it."""
    headers, page = response.headers, b""
    if headers.get("Content-Type", "").startswith("text/html"):
        is_packed = headers.get("Content-Encoding") == "gzip"
        response.body, page = _scripted(bytes(response.body or b""), is_packed)
        del headers["Content-Length"]
        headers["Content-Length"] = str(len(response.body))
    headers["Content-Security-Policy"] = _policy(page)
    headers["X-Content-Type-Options"] = "nosniff"
    headers["Referrer-Policy"] = "no-referrer"


@lru_cache(maxsize=4)
def _scripted(body: bytes, is_packed: bool) -> tuple[bytes, bytes]:
    """Return viser's page with our script at its beginning: as it is sent, and as text."""
    page = gzip.decompress(body) if is_packed else body
    page = page.replace(b"<head>", f"<head><script>{_BEFORE}</script>".encode(), 1)
    return (gzip.compress(page) if is_packed else page), page


@lru_cache(maxsize=4)
def _policy(page: bytes) -> str:
    """Allow the scripts that stand in the page, the one they insert, WebAssembly and workers; all of it is ours."""
    scripts = re.findall(rb"<script[^>]*>(.*?)</script>", page, re.DOTALL)
    hashes = [f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'" for script in scripts]
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(hashes)} 'nonce-{_NONCE}' 'wasm-unsafe-eval'",
            "worker-src blob:",
            "style-src 'unsafe-inline'",
            "img-src data: blob:",
            "font-src data:",
            "connect-src 'self' data: blob:",  # blob: textures of models
            "base-uri 'none'",
            "form-action 'none'",
            # The page frames it, which a notebook on this machine may frame in turn.
            "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*",
        ]
    )


class CheckedConnection(ServerConnection):
    """A connection that passes on only messages that viser can read; the first other one is logged."""

    def __init__(self, server: viser.ViserServer, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._viser, self._malformed = server, 0

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next message that is well formed."""
        while True:
            raw = await super().recv(decode)
            try:
                check_message(self._viser, raw)
            except Exception as error:  # Bytes from outside can fail in any way.
                self._malformed += 1
                if self._malformed == 1:
                    _LOG.warning("the 3D view leaves out a malformed message: %s", str(error).partition("\n")[0][:200])
                if self._malformed == MOST_MALFORMED:
                    await self.close(_POLICY_VIOLATION, f"{MOST_MALFORMED} malformed messages")
            else:
                return raw


def check_message(server: viser.ViserServer, raw: object) -> None:
    """Check that a message is of a kind that viser knows, and a value one that its widget can have.

    Raises:
        Exception: it is not.
    """
    if not isinstance(raw, bytes):
        raise TypeError("text instead of bytes")
    fields = msgspec.msgpack.decode(raw)
    message = msgspec.convert(fields, Message._subclass_from_type_string()[fields.pop("type")])
    Message.deserialize(raw)
    if isinstance(message, GuiUpdateMessage):
        if set(message.updates) != {"value"}:
            raise ValueError(f"changes {', '.join(message.updates) or 'nothing'} of a widget, not its value")
        widget, value = server.gui._gui_input_handle_from_uuid.get(message.uuid), message.updates["value"]
        options = getattr(widget, "options", None)
        if widget is not None and (not _is_like(value, widget._impl.value) or (options and value not in options)):
            raise ValueError(f"a {type(widget).__name__} cannot be {str(value)[:50]!r}")


def _is_like(value: object, present: object) -> bool:
    """Return whether a value is of the type of the present one, and no number beyond all measure."""
    if isinstance(present, tuple):
        return isinstance(value, list | tuple) and len(value) == len(present) and all(map(_is_like, value, present))
    if isinstance(present, int | float) and not isinstance(present, bool):
        return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST_NUMBER
    return isinstance(value, type(present))


def prepared(page: str) -> str:
    """Return a page that viser exported with what this page runs before viser's own; the same each time."""
    return page.replace("<head>", f"<head><script>{_BEFORE.replace(_NONCE, '')}</script>", 1)
