"""The web server of the page: viser, made safe for the user's own machine, with our script before its own, and with
pictures that browsers ask for one by one.

viser binds all interfaces, accepts websockets of any web page, opens a public tunnel for any client that asks, ends in
tracebacks over messages it cannot read, takes the next port silently when one is taken, and hangs on a host that cannot
be bound. None of that happens here.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import errno
import gzip
import hashlib
import http
import io
import logging
import re
import secrets
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from functools import lru_cache
from typing import Any

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from verefine_viz.batch.answer_cards import gallery_asset
from verefine_viz.core.errors import UnavailableError
from verefine_viz.rendering.gl_context import SOFTWARE
from verefine_viz.viewer.assets import asset
from verefine_viz.viewer.web.admission import Admission, Answer, check_refuses, in_url, is_loopback, reached_at, secured
from verefine_viz.viewer.web.client_messages import CheckedConnection, check_handling
from verefine_viz.viewer.web.viser_internals import LINK_LABEL

_LOG = logging.getLogger(__name__)
_CONSTRUCTION = threading.Lock()
_NONCE = secrets.token_urlsafe(16)
_SCRIPT = (
    "".join([*map(asset, ("page.js", "page_marks.js", "image_pane.js", "page_link.js")), gallery_asset("gallery.js")])
    .replace("NONCE", _NONCE)
    .replace("SOFTWARE_RENDERERS", "|".join(SOFTWARE))
    .replace("LINK_LABEL", LINK_LABEL)
)


_PICTURE = re.compile(r"/picture/(\d{1,9})")
_LONGEST_WAIT_S = 8.0
"""How long a request may wait for its picture [s]; websockets gives it 10. The browser asks again."""


class Server(viser.ViserServer):
    """A viser server that listens on one address only, and to pages that it served itself.

    Args:
        host: address to bind; anything but the loopback address is warned about.
        port: port to bind; 0 = any free one.
        allowed_origins: other pages that may use it, see :class:`Admission`.

    Raises:
        SettingsError: an allowed origin is none.
        UnavailableError: the port is taken, the host cannot be bound, or other sites' pages would be answered.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 8080, allowed_origins: Sequence[str] = ()) -> None:
        admission = Admission(host, allowed_origins)
        self.picture: Callable[[int], Future[bytes] | None] = lambda number: None
        """What ``/picture/N`` answers: a WebP file, empty = there is none; None = there is no such number."""
        check_address(host, port)
        if not is_loopback(host):
            _LOG.warning(
                "the page listens on %s: everybody who reaches this address can use it; "
                "for remote use prefer 127.0.0.1 and ssh -L %d:127.0.0.1:%d",
                host,
                port,
                port,
            )
        # viser prints a banner and takes no option for origins or scripts; all is seen to while it is built.
        with (
            _CONSTRUCTION,
            _served_our_way(admission, lambda number: self.picture(number)),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            super().__init__(host=host, port=port, verbose=False)
        check_handling(self)
        try:
            if port and self.get_port() != port:
                raise UnavailableError(f"{_taken(host, port)} (viser moved on to {self.get_port()})")
            check_refuses(host, self.get_port())
        except UnavailableError:
            self.stop()
            raise

    @property
    def url(self) -> str:
        """What to type into a browser on this machine."""
        return f"http://{in_url(reached_at(self.get_host()))}:{self.get_port()}"

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: the share tunnel would put the page on the internet at any client's request."""
        _LOG.warning("a client asked for a public share tunnel; refused")
        return None

    def stop(self) -> None:
        """Close all connections and free the port."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


def check_address(host: str, port: int) -> None:
    """Find out, before viser tries, whether an address can be bound.

    Raises:
        UnavailableError: the port is taken or not a port, or the host is not one of this machine's.
    """
    if not 0 <= port <= 65535:
        raise UnavailableError(f"port {port} does not exist; choose one from 1 to 65535, or 0 for any free one")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            probe.listen(1)
    except UnicodeError:  # Of a name with parts of more than 63 letters, or with letters that no name has.
        raise UnavailableError(f"host {host!r} is no name of a machine, expected 127.0.0.1 in most cases") from None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise UnavailableError(_taken(host, port)) from None
        if error.errno == errno.EACCES:
            raise UnavailableError(f"port {port} needs more rights than you have; choose one above 1023") from None
        raise UnavailableError(
            f"host {host!r} cannot be bound ({error.strerror or error}); expected an address of this machine, "
            "usually 127.0.0.1"
        ) from None


def _taken(host: str, port: int) -> str:
    return (
        f"port {port} on {host} is taken; stop the program that uses it, or choose another: --port N, or "
        "make app PORT=N (0 = any free one)"
    )


@contextlib.contextmanager
def _served_our_way(admission: Admission, picture: Callable[[int], Future[bytes] | None]) -> Iterator[None]:
    """While viser starts, its web server gets what viser has no options for: whom to answer, with which script before
    the page and which headers, and the check of what browsers send.
    """
    original = websockets.asyncio.server.serve

    def serve(*args: Any, process_request: Answer, **kwargs: Any) -> Any:
        ours = {
            "process_request": admission.guarded(_with_pictures(_with_script(process_request), picture)),
            "process_response": secured,
            "create_connection": CheckedConnection,
        }
        return original(*args, **{**kwargs, **ours})

    websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = original  # type: ignore[misc]


# Pictures of a batch's answers, each made when a browser asks for it


def _with_pictures(answer: Answer, picture: Callable[[int], Future[bytes] | None]) -> Answer:
    """Serves ``/picture/N``; everything else as it was."""

    def answer_with_picture(connection: ServerConnection, request: Request) -> Any:
        asked = _PICTURE.fullmatch(request.path)
        future = picture(int(asked[1])) if asked is not None else None
        return answer(connection, request) if future is None else _picture_response(future)

    return answer_with_picture


async def _picture_response(future: Future[bytes]) -> Response:
    try:
        made = await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(future)), _LONGEST_WAIT_S)
    except TimeoutError:
        return _response(http.HTTPStatus.SERVICE_UNAVAILABLE, b"")
    return _response(http.HTTPStatus.OK if made else http.HTTPStatus.NO_CONTENT, made)


def _response(status: http.HTTPStatus, body: bytes) -> Response:
    headers = Headers(
        {"Content-Type": "image/webp", "Content-Length": str(len(body)), "Cross-Origin-Resource-Policy": "same-origin"}
    )
    return Response(status.value, status.phrase, headers, body)


# Our script at the beginning of viser's page, and a policy of what may run there: viser has no settings for either


def _with_script(answer: Answer) -> Answer:
    """Serves the page with our script at its very beginning and a policy of what may run; everything else as it was."""

    def answer_with_script(connection: ServerConnection, request: Request) -> Response | None:
        response = answer(connection, request)
        assert response is None or isinstance(response, Response)  # viser's own are not awaited.
        if response is None or response.status_code != http.HTTPStatus.OK:
            return response
        if not response.headers.get("Content-Type", "").startswith("text/html"):
            return response
        is_packed = response.headers.get("Content-Encoding") == "gzip"
        response.body, response.headers["Content-Security-Policy"] = _scripted(bytes(response.body or b""), is_packed)
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))
        return response

    return answer_with_script


@lru_cache(maxsize=4)
def _scripted(page: bytes, is_packed: bool) -> tuple[bytes, str]:
    """The page with our script, and its policy."""
    page = gzip.decompress(page) if is_packed else page
    script = f"<head><script>{_SCRIPT}</script>"
    page = page.replace(b"<head>", script.encode(), 1)
    return gzip.compress(page) if is_packed else page, _policy(page)


def _policy(page: bytes) -> str:
    """The scripts that stand in a page, the one they insert, WebAssembly and workers; styles, and pictures sent by us.

    Nothing is fetched from elsewhere, and no page may show this one within itself.
    """
    scripts = re.findall(rb"<script[^>]*>(.*?)</script>", page, re.DOTALL)
    hashes = [f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'" for script in scripts]
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(hashes)} 'nonce-{_NONCE}' 'wasm-unsafe-eval'",
            "worker-src blob:",
            "style-src 'unsafe-inline'",
            "img-src data: blob:",
            "connect-src 'self' data: blob:",  # blob: textures of models
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ]
    )
