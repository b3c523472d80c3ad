"""The 3D view under ``/3d/``: viser's page, and its websocket, handed through from a server on another port."""

from __future__ import annotations

import asyncio

from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake

_GOING_AWAY, _TRY_AGAIN = 1001, 1013
_NEVER_SENT = (1005, 1006, 1015)
"""Close codes that say how a connection ended without one."""


def routes(document: str, policy: str, address: str) -> list[BaseRoute]:
    """Return the routes of ``/3d/``.

    Host and Origin are checked by the page's server, for its own address, before a request comes here.

    Args:
        document: viser's page.
        policy: its Content-Security-Policy; what adds one to other answers has to leave it as it is.
        address: that of viser's websocket.
    """

    async def page(request: Request) -> Response:
        return HTMLResponse(document, headers={"content-security-policy": policy, "cache-control": "no-cache"})

    async def channel(browser: WebSocket) -> None:
        await _handed_through(browser, address)

    # viser's page takes its own address without the last slash for that of its websocket.
    return [Route("/3d/", page), WebSocketRoute("/3d", channel), WebSocketRoute("/3d/", channel)]


async def _handed_through(browser: WebSocket, address: str) -> None:
    """Pass messages both ways until one side closes, then close the other.

    At most a few messages wait on either side: a sender waits until its message is on its way.
    """
    asked = browser.scope["subprotocols"]
    try:
        # No size limit: what comes is our own, and viser limits what goes to it. What waits is bounded by max_queue.
        behind = await connect(
            address, subprotocols=asked, compression=None, max_size=None, max_queue=4, proxy=None, ping_interval=None,
            close_timeout=2,
        )  # fmt: skip
    except (OSError, InvalidHandshake, TimeoutError):
        await browser.close(_TRY_AGAIN)
        return
    async with behind:
        await browser.accept(behind.subprotocol)
        ways = [asyncio.create_task(_to_viser(browser, behind)), asyncio.create_task(_to_browser(behind, browser))]
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)


async def _to_viser(browser: WebSocket, behind: ClientConnection) -> None:
    """Pass messages on until the browser has gone, or viser."""
    try:
        while True:
            message = await browser.receive()
            if message["type"] == "websocket.disconnect":
                return
            data = message.get("bytes")
            await behind.send(message["text"] if data is None else data)
    except ConnectionClosed:
        return


async def _to_browser(behind: ClientConnection, browser: WebSocket) -> None:
    """Pass messages on until viser closes, which closes the browser's side alike, or the browser has gone."""
    try:
        try:
            async for message in behind:
                await (browser.send_text(message) if isinstance(message, str) else browser.send_bytes(message))
        except ConnectionClosed:
            pass
        code = behind.close_code
        await browser.close(_GOING_AWAY if code in (None, *_NEVER_SENT) else code, behind.close_reason)
    except (WebSocketDisconnect, RuntimeError):
        return  # starlette's word for a browser that closed meanwhile is a RuntimeError.
