"""The page's server: its files, its websocket, binary arrays, thumbnails, and the 3D view behind it."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from itertools import count
from pathlib import Path
from typing import Any

import anyio.to_thread
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.core.files import id_of
from verefine_viz.page.admission import Admission, Guard, is_loopback, policy, reached_at, url_host
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.messages import AnyMessage
from verefine_viz.page.protocol import AnyVerb, encoded, read_verb
from verefine_viz.page.sent_palette import hello
from verefine_viz.page.web_files import WEB, import_map_hash

_LOG = logging.getLogger(__name__)
MOST_FAULTS = 10
"""Number of malformed messages after which a window is closed."""
MOST_MESSAGES = 20_000
"""Most messages that wait for a window; one that does not take them is closed."""
MOST_THREADS = 4
"""Threads that read files and fetch data for the 3D view; they stay alive."""
_LONGEST_WAIT_S = 30.0
"""For a thumbnail."""
Receive = Callable[[int, AnyVerb | None], None]
"""Receives the verb or want of a window; None = it has just connected."""


class Window:
    """One browser window."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.out: asyncio.Queue[str | None] = asyncio.Queue(MOST_MESSAGES)
        """Messages to send; None = close."""

    def put(self, message: str | None) -> None:
        """Queue a message for sending."""
        try:
            self.out.put_nowait(message)
        except asyncio.QueueFull:
            _LOG.warning("window %d takes no messages; closed", self.number)
            while not self.out.empty():
                self.out.get_nowait()
            self.out.put_nowait(None)


class PageServer:
    """Serves one page until it is stopped.

    Args:
        host: address to listen on.
        port: port to listen on; 0 = any free one.
        allowed_origins: other addresses of the page, see :class:`Admission`.
        receive: gets what windows ask for, on the server's thread.
        blobs: binary arrays by key.
        thumbnail: begins to make the small picture of an answer of the gallery (WebP); None = there is none.
        frame_picture: the same of a frame of the session.
        film: the same of the key moments of an answer of the gallery.
        file: gives the file of a name that this program wrote, to download; None = it wrote none.
        closed: gets the number of a window that was closed, on the server's thread.

    Raises:
        SettingsError: an allowed origin is not an origin.
        UnavailableError: the address cannot be bound.
    """

    def __init__(
        self,
        host: str,
        port: int,
        allowed_origins: Sequence[str],
        receive: Receive,
        blobs: Blobs,
        thumbnail: Callable[[int], Future[bytes] | None] = lambda number: None,
        frame_picture: Callable[[int], Future[bytes] | None] = lambda number: None,
        model_picture: Callable[[int], Future[bytes] | None] = lambda number: None,
        film: Callable[[int], Future[bytes] | None] = lambda number: None,
        file: Callable[[str], Path | None] = lambda name: None,
        closed: Callable[[int], None] = lambda window: None,
    ) -> None:
        self._closed = closed
        self._receive, self._blobs, self._thumbnail, self._file = receive, blobs, thumbnail, file
        self._frame_picture, self._model_picture, self._film_strip = frame_picture, model_picture, film
        self._windows: dict[int, Window] = {}
        self._numbers = count(1)
        admission = Admission(host, allowed_origins)
        self._socket = bind(host, port)
        self.host, self.port = host, int(self._socket.getsockname()[1])
        if not is_loopback(host):
            _LOG.warning(
                "%s is no loopback address: all who reach it can use the page; for remote use prefer 127.0.0.1 and "
                "ssh -L %d:127.0.0.1:%d", host, self.port, self.port,
            )  # fmt: skip
        self._app = Starlette(
            routes=[
                Route("/", _page),
                Route("/blob/{key}", self._blob),
                Route("/thumb/{number}", self._thumb),
                Route("/film/{number}", self._film),
                Route("/frame/{number}", self._frame),
                Route("/model/{number}", self._model),
                Route("/file/{name}", self._written),
                WebSocketRoute("/ws", self._talk),
                Mount("/web", _Files(directory=WEB)),
            ]
        )
        config = uvicorn.Config(
            Guard(self._app, admission, lambda: self.port),
            log_config=None, access_log=False, lifespan="off", ws="websockets-sansio", ws_max_size=4 * 1024**2,
            timeout_graceful_shutdown=1,
        )  # fmt: skip
        self._server = uvicorn.Server(config)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._is_up = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="verefine-server", daemon=True)

    @property
    def url(self) -> str:
        """The address to type into a browser on this machine."""
        return f"http://{url_host(reached_at(self.host))}:{self.port}"

    def start(self, routes: Sequence[BaseRoute] = ()) -> None:
        """Serve on a thread of its own, with further ``routes``, such as the 3D view's."""
        self._app.router.routes.extend(routes)
        self._thread.start()
        self._is_up.wait(timeout=20)

    def stop(self) -> None:
        """Close all connections and free the port."""
        self._server.should_exit = True
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(lambda: [window.put(None) for window in self._windows.values()])
        self._thread.join(timeout=10)
        self._socket.close()

    def post(self, message: AnyMessage, window: int | None = None) -> None:
        """Send a message to a window, or to all. Callable from any thread."""
        text = encoded(message).decode()
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._put, text, window)

    # The server's thread

    def _serve(self) -> None:
        async def serve() -> None:
            self._loop = asyncio.get_running_loop()
            anyio.to_thread.current_default_thread_limiter().total_tokens = MOST_THREADS
            self._loop.call_later(0, self._is_up.set)
            await self._server.serve(sockets=[self._socket])

        asyncio.run(serve())

    def _put(self, text: str, window: int | None) -> None:
        for one in [*self._windows.values()] if window is None else filter(None, [self._windows.get(window)]):
            one.put(text)

    async def _talk(self, socket: WebSocket) -> None:
        await socket.accept()
        window = Window(next(self._numbers))
        self._windows[window.number] = window
        await socket.send_text(encoded(hello(window.number)).decode())
        self._receive(window.number, None)
        sending = asyncio.create_task(_send_all(socket, window))
        try:
            await self._listen(socket, window)
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            del self._windows[window.number]
            sending.cancel()
            self._closed(window.number)

    async def _listen(self, socket: WebSocket, window: Window) -> None:
        faults = 0
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            try:
                verb = read_verb(message.get("text") or "")
            except InputError as error:
                faults += 1
                _LOG.warning("window %d: %s", window.number, error)
                if faults >= MOST_FAULTS:
                    _LOG.warning("window %d sent %d malformed messages; closed", window.number, faults)
                    await socket.close(1008)
                    return
                continue
            self._receive(window.number, verb)

    async def _blob(self, request: Request) -> Response:
        blob = self._blobs.get(request.path_params["key"])
        if blob is None:
            return Response(status_code=404)
        return Response(blob.data, media_type=blob.media_type, headers={"cache-control": "no-store"})

    async def _thumb(self, request: Request) -> Response:
        return await self._picture(request, self._thumbnail)

    async def _film(self, request: Request) -> Response:
        return await self._picture(request, self._film_strip)

    async def _frame(self, request: Request) -> Response:
        return await self._picture(request, self._frame_picture)

    async def _model(self, request: Request) -> Response:
        return await self._picture(request, self._model_picture)

    async def _picture(self, request: Request, begin: Callable[[int], Future[bytes] | None]) -> Response:
        number = id_of(request.path_params["number"])
        future = None if number is None else begin(number)
        if future is None:
            return Response(status_code=404)
        try:
            made = await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(future)), _LONGEST_WAIT_S)
        except TimeoutError:
            return Response(status_code=503)
        # The address names the answer or the frame, so the browser need not ask again.
        cached = {"cache-control": "private, max-age=3600"}
        return Response(made, media_type="image/webp", headers=cached) if made else Response(status_code=404)

    async def _written(self, request: Request) -> Response:
        path = self._file(request.path_params["name"])
        if path is None or not path.is_file():
            return Response(status_code=404)
        return FileResponse(path, filename=path.name, headers={"cache-control": "no-store"})


def _page(request: Request) -> Response:
    headers = {"cache-control": "no-cache", "content-security-policy": policy(f"'{import_map_hash()}'")}
    return FileResponse(WEB / "index.html", headers=headers)


class _Files(StaticFiles):
    """Files that browsers request again each time, so that versions are never mixed."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        response = super().file_response(*args, **kwargs)
        response.headers["cache-control"] = "no-cache"
        return response


async def _send_all(socket: WebSocket, window: Window) -> None:
    while (text := await window.out.get()) is not None:
        await socket.send_text(text)
    await socket.close(1001)


def bind(host: str, port: int) -> socket.socket:
    """Bind a socket to an address of this machine.

    Raises:
        UnavailableError: the port is taken or not a port, or the host is not one of this machine's.
    """
    if not 0 <= port <= 65535:
        raise UnavailableError(f"port {port} does not exist; choose one from 1 to 65535, or 0 for any free one")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        bound = socket.socket(family, kind, protocol)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            bound.bind(address)
            bound.listen(128)
        except OSError:
            bound.close()
            raise
        return bound
    except UnicodeError:  # A name with parts of more than 63 letters, or with letters that host names cannot have.
        raise UnavailableError(f"host {host!r} is no name of a machine, expected 127.0.0.1 in most cases") from None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise UnavailableError(
                f"port {port} on {host} is taken; stop the program that uses it, or choose another: --port N, or "
                "make app PORT=N (0 = any free one)"
            ) from None
        if error.errno == errno.EACCES:
            raise UnavailableError(f"port {port} needs more rights than you have; choose one above 1023") from None
        raise UnavailableError(
            f"host {host!r} cannot be bound ({error.strerror or error}); expected an address of this machine, "
            "usually 127.0.0.1"
        ) from None
