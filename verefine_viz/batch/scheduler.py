"""Whether a Dask scheduler answers at an address, and if not, why."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from socket import create_connection, gaierror

from distributed import Security
from distributed.comm.addressing import get_address_host_port, parse_address, resolve_address
from distributed.comm.core import connect

from verefine_viz.core.errors import SettingsError

CONNECT_S = 10.0
"""Who has not answered by then is not there."""
OVER_TCP = ("tcp", "tls", "ws", "wss")


def check_address(address: str) -> None:
    """
    Raises:
        SettingsError: it is no address, whether or not something answers there.
    """
    try:
        with suppress(OSError, ImportError, FutureWarning):  # Said when it does not answer.
            resolve_address(address)
    except ValueError:
        raise SettingsError(
            f"--cluster {address} is no address; expected tcp://HOST:PORT of a Dask scheduler, or local"
        ) from None


def must_answer(address: str) -> None:
    """Returns when something that speaks Dask's language answers; its client would wait for the first word for ever.

    Raises:
        Exception: nothing does in time, or something else does, which may send anything; see :func:`why_not`.
    """
    if parse_address(address)[0] in OVER_TCP:  # Dask would knock again and again, until its time is up.
        create_connection(get_address_host_port(address), CONNECT_S).close()
    asyncio.run(_answers(address))


async def _answers(address: str) -> None:
    arguments = Security().get_connection_args("client")
    comm = await asyncio.wait_for(connect(address, timeout=CONNECT_S, **arguments), CONNECT_S)
    comm.abort()


def why_not(error: Exception) -> str:
    """What kept something at an address from answering, in words."""
    said = " ".join(str(error).split())
    match error:
        case ConnectionRefusedError():
            return "nothing listens there"
        case gaierror():
            return "no host of that name is known"
        case TimeoutError():
            return f"it said nothing for {CONNECT_S:g} s"
        case OSError() | ImportError() | Warning() if said:
            return said
    return "what listens there is no Dask scheduler, or one of another version"
