"""The web server of the page: viser, made safe for a person's own machine.

viser binds all interfaces, accepts websockets of any web page, opens a public tunnel for any client that asks, takes
the next port silently when one is taken, and hangs on a host that cannot be bound. None of that happens here.
"""

from __future__ import annotations

import contextlib
import errno
import io
import ipaddress
import logging
import re
import socket
import threading
from collections.abc import Iterator
from typing import Any

import viser
import websockets.asyncio.server

from verefine_viz.core.errors import UnavailableError
from verefine_viz.viewer.page_script import Answer, with_script

_LOG = logging.getLogger(__name__)
_CONSTRUCTION = threading.Lock()
_LOCAL_NAMES = ("127.0.0.1", "localhost", "[::1]")


class Server(viser.ViserServer):
    """A viser server that listens on one address only, and to pages that it served itself.

    Args:
        host: address to bind; anything but the loopback address is warned about.
        port: port to bind; 0 = any free one.

    Raises:
        UnavailableError: the port is taken, or the host cannot be bound.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 8080) -> None:
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
        with _CONSTRUCTION, _served_our_way(allowed_origins(host)), contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=host, port=port, verbose=False)
        if port and self.get_port() != port:
            taken = self.get_port()
            self.stop()
            raise UnavailableError(f"{_taken(host, port)} (viser moved on to {taken})")

    @property
    def url(self) -> str:
        """What to type into a browser on this machine."""
        host = self.get_host()
        shown = "127.0.0.1" if host in ("0.0.0.0", "::", "") else f"[{host}]" if ":" in host else host
        return f"http://{shown}:{self.get_port()}"

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: the share tunnel would put the page on the internet at any client's request."""
        _LOG.warning("a client asked for a public share tunnel; refused")
        return None

    def stop(self) -> None:
        """Close all connections and free the port."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def allowed_origins(host: str) -> list[re.Pattern[str] | None]:
    """Which web pages may open a websocket: none (a program), our own address, and by number where all are bound.

    Names other than our own are refused even then: a hostile site can point its own name at this machine.
    """
    names = [re.escape(name) for name in _LOCAL_NAMES]
    if not is_loopback(host):
        names += [re.escape(host), re.escape(socket.gethostname())]
    if host in ("0.0.0.0", "::", ""):
        names += [r"\d+\.\d+\.\d+\.\d+", r"\[[0-9a-f:]+\]"]
    return [None, re.compile(rf"https?://(?:{'|'.join(names)})(?::\d+)?")]


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
def _served_our_way(origins: list[re.Pattern[str] | None]) -> Iterator[None]:
    """While viser starts, its web server is told which origins to accept and which script to begin the page with."""
    original = websockets.asyncio.server.serve

    def serve(*args: Any, process_request: Answer, **kwargs: Any) -> Any:
        return original(*args, **{**kwargs, "process_request": with_script(process_request), "origins": origins})

    websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = original  # type: ignore[misc]
