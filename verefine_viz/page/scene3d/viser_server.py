"""viser's server for the 3D view, on a loopback port of its own that answers the page's proxy alone.

Two strangers can reach a loopback port: another site's page in the user's browser, as browsers let any page open
websockets to this machine and ports can be tried one after another, and another user of the machine. On viser's port
either would get the scene, which is the user's photo, depth and models, could drag poses, and could have viser open a
public tunnel to it. So the port answers one path of 256 random bits, which the proxy alone knows, and no tunnel is
opened. The proxy is reached through the page's server, which refuses other sites' pages (``admission.py``). Another
user who connects to that server needs no secret: it has no login (SECURITY.md).

viser has no option for a path: its websocket server is wrapped while it starts. Its own web server is not used, as the
page comes from ``viser_page.py``. A message that it cannot read ends the connection that it came by, and no other.
"""

from __future__ import annotations

import contextlib
import io
import logging
import secrets
import threading
from collections.abc import Iterator
from http import HTTPStatus
from typing import Any

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

_LOG = logging.getLogger(__name__)
_CONSTRUCTION = threading.Lock()
MOST_THREADS = 2
"""Threads for callbacks, which are short; viser keeps up to 32 for good."""


class Viser3DServer(viser.ViserServer):
    """A viser server on a free loopback port, for the proxy of the page; it opens no share tunnel."""

    def __init__(self) -> None:
        self._path = f"/{secrets.token_urlsafe(32)}"
        # viser prints a banner whatever it is asked.
        with _CONSTRUCTION, _answering_only(self._path), contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host="127.0.0.1", port=0, verbose=False)
        self._thread_executor._max_workers = MOST_THREADS

    @property
    def address(self) -> str:
        """Where its websocket is; not to be given away."""
        return f"ws://127.0.0.1:{self.get_port()}{self._path}"

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse the tunnel that would put the view on the internet at any client's request."""
        _LOG.warning("a client asked for a public share tunnel; refused")
        return None

    def stop(self) -> None:
        """Close all connections and free the port."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


@contextlib.contextmanager
def _answering_only(path: str) -> Iterator[None]:
    """Websocket servers that start within this answer 403 at any other path."""
    original = websockets.asyncio.server.serve

    def answer(connection: ServerConnection, request: Request) -> Response | None:
        if secrets.compare_digest(request.path.encode("utf-8", "replace"), path.encode()):
            return None
        return connection.respond(HTTPStatus.FORBIDDEN, "not a page of this program\n")

    def serve(*args: Any, **kwargs: Any) -> Any:
        return original(*args, **{**kwargs, "process_request": answer})

    websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = original  # type: ignore[misc]
