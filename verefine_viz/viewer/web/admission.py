"""Who may talk to the page's server: its own page and programs of this machine, and no other site's page.

Two things tell a foreign page. Its websocket carries its Origin, which is not ours. And where a hostile site points its
own name at this machine (DNS rebinding), so that Origin and server agree, the requests carry that name as Host.
"""

from __future__ import annotations

import http.client
import ipaddress
import re
import socket
from collections.abc import Awaitable, Callable, Sequence
from http import HTTPStatus
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from verefine_viz.core.errors import SettingsError, UnavailableError

Answer = Callable[[ServerConnection, Request], Response | Awaitable[Response] | None]
"""What a web server answers to a request, now or later; None = nothing, it opens a websocket."""

_LOCAL_NAMES = ("127.0.0.1", "localhost", "[::1]")
_EVERYWHERE = {"0.0.0.0": "127.0.0.1", "": "127.0.0.1", "::": "::1"}
"""Hosts that stand for all addresses of this machine, and one of these."""
_USUAL_PORTS = {"http": 80, "https": 443}
_ORIGIN = re.compile(r"(https?)://([a-z0-9._-]+|\[[0-9a-f:.]+\])(?::([0-9]{1,5}))?/?", re.IGNORECASE)
_HEADERS = {
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
_NOTHING_RUNS = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"


class Admission:
    """Decides which requests are answered.

    Args:
        host: address that the server is bound to.
        allowed: origins of other pages that may use the server, and addresses at which this page is reached besides its
            own (as by a tunnel whose near end has another port), such as ``http://localhost:3000``.

    Raises:
        SettingsError: one of these is no origin.
    """

    def __init__(self, host: str, allowed: Sequence[str] = ()) -> None:
        names: list[str] = [*_LOCAL_NAMES]
        if not is_loopback(host):
            names.append(socket.gethostname().lower())
        if host not in _EVERYWHERE:
            names.append(in_url(host).lower())
        self._names, self._is_everywhere = names, host in _EVERYWHERE
        self._allowed = {read_origin(text) for text in allowed}

    def admits(self, port: int, hosts: Sequence[str], origins: Sequence[str]) -> bool:
        """Whether the server at a port answers a request with these headers: one Host, and one Origin from a page.

        Where all addresses are bound any address by number may be ours; a page must then come from the one it talks to.
        """
        if len(hosts) != 1 or len(origins) > 1:
            return False
        host = hosts[0].lower()
        ours = {_origin("http", name, port) for name in self._names} | self._allowed
        if self._is_everywhere and _is_number(host, port):
            ours.add(f"http://{host}")
        return host in {origin.partition("://")[2] for origin in ours} and (not origins or origins[0] in ours)

    def guarded(self, answer: Answer) -> Answer:
        """Refuses what is not admitted, in words for the user who typed the address; answers the rest as before."""

        def answer_if_admitted(connection: ServerConnection, request: Request) -> Response | Awaitable[Response] | None:
            port = connection.local_address[1]
            if self.admits(port, request.headers.get_all("Host"), request.headers.get_all("Origin")):
                return answer(connection, request)
            return connection.respond(
                HTTPStatus.FORBIDDEN,
                f"This page is at {_origin('http', _LOCAL_NAMES[0], port)} and answers no other site. To reach it at "
                "another address, start it with that: --allow-origin http://localhost:3000\n",
            )

        return answer_if_admitted


def secured(connection: ServerConnection, request: Request, response: Response) -> None:
    """Adds to any answer that no page may frame it; where it has no policy of its own, also that nothing in it runs."""
    for name, value in _HEADERS.items():
        response.headers[name] = value
    if "Content-Security-Policy" not in response.headers:
        response.headers["Content-Security-Policy"] = _NOTHING_RUNS


def check_refuses(host: str, port: int) -> None:
    """Asks a server that has just started for a websocket, once as a foreign page and once by a foreign name.

    Raises:
        UnavailableError: it does not refuse both.
    """
    own = reached_at(host)
    name, foreign = f"{in_url(own)}:{port}", "foreign.invalid"
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version": "13",
    }
    for headers in (
        {"Host": name, "Origin": f"http://{foreign}"},
        {"Host": f"{foreign}:{port}", "Origin": f"http://{foreign}:{port}"},
    ):
        asking = http.client.HTTPConnection(own, port, timeout=20)
        try:
            asking.request("GET", "/", headers={**upgrade, **headers})
            status = asking.getresponse().status
        except (OSError, http.client.HTTPException) as error:
            raise UnavailableError(f"the page's server does not answer at {name} ({error}); start it again") from None
        finally:
            asking.close()
        if status != HTTPStatus.FORBIDDEN:
            raise UnavailableError(
                f"the page is not served, because it would answer other sites' pages (status {status}, expected 403): "
                "this viser goes round the check; install the one that fits: pip install 'viser>=1.1.1,<1.2'"
            )


def read_origin(text: str) -> str:
    """An origin as browsers write it: scheme, name and port, in small letters and without the usual port.

    Raises:
        SettingsError: it is none.
    """
    match = _ORIGIN.fullmatch(text)
    if match is None or not 0 < int(match[3] or 1) <= 65535:
        raise SettingsError(
            f"--allow-origin {text!r} is no origin; expected scheme, name and port alone, such as http://localhost:3000"
        )
    scheme = match[1].lower()
    return _origin(scheme, match[2].lower(), int(match[3] or _USUAL_PORTS[scheme]))


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def reached_at(host: str) -> str:
    """At which address this machine reaches a server that is bound to a host."""
    return _EVERYWHERE.get(host, host)


def in_url(host: str) -> str:
    """A host as it stands in an address."""
    return f"[{host}]" if ":" in host else host


def _origin(scheme: str, name: str, port: int) -> str:
    return f"{scheme}://{name}" if port == _USUAL_PORTS[scheme] else f"{scheme}://{name}:{port}"


def _is_number(host: str, port: int) -> bool:
    """Whether a Host is an address by number and this port: there is no name in it that could be pointed elsewhere."""
    try:
        parts = urlsplit(f"//{host}")
        ipaddress.ip_address(parts.hostname or "")
        return (parts.port or _USUAL_PORTS["http"]) == port
    except ValueError:
        return False
