"""Who may talk to the page's server: its own page and programs of this machine, and no other site's page.

Two things tell a foreign page. Its websocket carries its Origin, which is not ours. And where a hostile site points its
own name at this machine (DNS rebinding), so that Origin and server agree, the requests carry that name as Host.
"""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Callable, Sequence
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from verefine_viz.core.errors import SettingsError

_LOCAL_NAMES = ("127.0.0.1", "localhost", "[::1]")
_EVERYWHERE = {"0.0.0.0": "127.0.0.1", "": "127.0.0.1", "::": "::1"}
"""Hosts that stand for all addresses of this machine, and one of these."""
_USUAL_PORTS = {"http": 80, "https": 443}
_ORIGIN = re.compile(r"(https?)://([a-z0-9._-]+|\[[0-9a-f:.]+\])(?::([0-9]{1,5}))?/?", re.IGNORECASE)


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
            names.append(url_host(host).lower())
        self._names, self._is_everywhere = names, host in _EVERYWHERE
        self._allowed = {_read_origin(text) for text in allowed}

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


def _read_origin(text: str) -> str:
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


def url_host(host: str) -> str:
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


class Guard:
    """Answers only what is admitted, HTTP and websockets alike, and sets the headers of every answer.

    Args:
        app: the ASGI application behind it.
        admission: decides.
        port: returns the port of the server.
    """

    def __init__(self, app: ASGIApp, admission: Admission, port: Callable[[], int]) -> None:
        self._app, self._admission, self._port = app, admission, port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            return await self._app(scope, receive, send)
        headers = [(name, value.decode("latin-1")) for name, value in scope["headers"]]
        hosts, origins = ([v for n, v in headers if n == name] for name in (b"host", b"origin"))
        if self._admission.admits(self._port(), hosts, origins):
            return await self._app(scope, receive, _with_headers(send))
        if scope["type"] == "websocket" and "websocket.http.response" not in scope.get("extensions", {}):
            return await send({"type": "websocket.close", "code": 1008})  # The server answers 403.
        kind = "websocket.http.response" if scope["type"] == "websocket" else "http.response"
        words = (
            f"This page is at {_origin('http', _LOCAL_NAMES[0], self._port())} and answers no other site. To reach it "
            "at another address, start it with that: --allow-origin http://localhost:3000\n"
        )
        await send({"type": f"{kind}.start", "status": 403, "headers": [(b"content-type", b"text/plain"), *_HEADERS]})
        await send({"type": f"{kind}.body", "body": words.encode()})


def policy(*scripts: str) -> str:
    """Return the Content-Security-Policy of an answer: it loads files of this server only.

    Args:
        scripts: hashes, in quotes, of scripts inside the document.
    """
    allowed = " ".join(["'self'", *scripts])
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'self'; "
        "img-src 'self' data: blob:; connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; "
        # A notebook on this machine shows the page within itself.
        "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*"
    )


_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


def _with_headers(send: Send) -> Send:
    """Add the headers of every answer; the policy too, where the answer has none of its own."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = list(message.get("headers", []))
            if not any(name.lower() == b"content-security-policy" for name, _ in given):
                given.append((b"content-security-policy", policy().encode()))
            message = {**message, "headers": [*given, *_HEADERS]}
        await send(message)

    return send_with_headers
