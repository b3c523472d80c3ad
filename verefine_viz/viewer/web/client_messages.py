"""What arrives from a browser, checked before viser sees it: its server ends in a traceback over what it cannot read.

Written for viser 1.1.1. It reads by ``connection.recv()``, and carries out by ``_handle_incoming_message`` of its
websocket server and of the client's connection. Of its private parts these are used: ``_messages.Message`` with
``_subclass_from_type_string`` and ``deserialize``, ``ViserServer._websock_server``, its ``_live_connections`` and
``_handle_incoming_message``, ``GuiApi._gui_input_handle_from_uuid``, and ``_impl.value`` of a widget.
"""

from __future__ import annotations

import logging
from typing import Any

import msgspec
import viser
from viser._messages import GuiUpdateMessage
from viser._messages import Message as ViserMessage
from viser.infra import ClientId, Message, WebsockClientConnection, WebsockServer
from websockets.asyncio.server import ServerConnection

from verefine_viz.core.errors import in_one_line

_LOG = logging.getLogger(__name__)
MOST_MALFORMED = 10
"""So many malformed messages and a client is disconnected."""
_POLICY_VIOLATION = 1008
_LARGEST_INTEGER = 2**53
"""Browsers count no further. An integer above 2^64 in a widget would end the connection of every browser for good."""


class CheckedConnection(ServerConnection):
    """A connection that passes on only messages that viser can read; the first other one is logged."""

    _malformed = 0

    async def recv(self, decode: bool | None = None) -> Any:
        """The next message that is well formed."""
        while True:
            raw = await super().recv(decode)
            try:
                check_message(raw)
            except Exception as error:  # Bytes from outside can fail in any way.
                await self.complain(error)
            else:
                return raw

    async def complain(self, error: Exception) -> None:
        """A message was malformed; the client that sends too many is disconnected."""
        self._malformed += 1
        if self._malformed == 1:
            _LOG.warning(
                "a browser at %s sent a message that cannot be read (%s); it is left out, and after %d such messages "
                "the browser is disconnected",
                self.remote_address[0],
                in_one_line(f"{type(error).__name__}: {error}")[:200],
                MOST_MALFORMED,
            )
        if self._malformed == MOST_MALFORMED:
            await self.close(_POLICY_VIOLATION, f"{MOST_MALFORMED} malformed messages")


def check_message(raw: object) -> None:
    """That a message is of a kind that viser knows and has the fields of that kind.

    Raises:
        Exception: it is not.
    """
    if not isinstance(raw, bytes):
        raise TypeError("text instead of bytes")
    fields = msgspec.msgpack.decode(raw)
    kind = ViserMessage._subclass_from_type_string()[fields.pop("type")]
    message = msgspec.convert(fields, kind)
    ViserMessage.deserialize(raw)
    if isinstance(message, GuiUpdateMessage) and set(message.updates) != {"value"}:
        raise ValueError(f"changes {', '.join(message.updates) or 'nothing'} of a widget, not its value")


def check_handling(server: viser.ViserServer) -> None:
    """What cannot be carried out counts as malformed as well, a value that a widget cannot have among it."""

    def checked(handler: WebsockServer | WebsockClientConnection) -> None:
        handle = handler._handle_incoming_message

        async def handle_or_complain(client_id: ClientId, message: Message) -> None:
            try:
                if not isinstance(message, GuiUpdateMessage) or _is_offered(server, message):
                    await handle(client_id, message)
            except Exception as error:  # As above.
                connection = server._websock_server._live_connections.get(client_id)
                if isinstance(connection, CheckedConnection):
                    await connection.complain(error)

        handler._handle_incoming_message = handle_or_complain

    checked(server._websock_server)
    server._websock_server.on_client_connect(checked)


def _is_offered(server: viser.ViserServer, message: GuiUpdateMessage) -> bool:
    """Whether a choice is one of those that its widget has; others may have been there a moment ago.

    Raises:
        ValueError: the value is of a type that the widget never has.
    """
    widget = server.gui._gui_input_handle_from_uuid.get(message.uuid)
    if widget is None:
        return True  # viser leaves it out itself.
    value = message.updates["value"]
    if not _is_like(value, widget._impl.value):
        raise ValueError(f"a {type(widget).__name__} cannot be {str(value)[:50]!r}")
    options = getattr(widget, "options", None)
    return options is None or value in options


def _is_like(value: object, present: object) -> bool:
    """Whether a value that was sent is of the type of the present one, and no number beyond all measure."""
    if isinstance(present, tuple):
        are_all = isinstance(value, list | tuple) and len(value) == len(present)
        return are_all and all(_is_like(x, y) for x, y in zip(value, present, strict=True))  # type: ignore[arg-type]
    if isinstance(present, int | float) and not isinstance(present, bool):
        return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST_INTEGER
    return isinstance(value, type(present))
