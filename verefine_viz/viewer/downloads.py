"""Hands exports to the browser that asked: through an ssh tunnel there is no other way to what lies on the server."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import viser

from verefine_viz.viewer import commands as c

LARGEST_BYTES = 100_000_000
"""What is larger is left on disk: the page holds a download in memory until it is whole, and 100 MB take 80 s at
10 Mbit/s."""
PART_BYTES = 16_384
"""The page's own messages wait for 128 parts at most, so that it stays in use meanwhile also on a slow line."""


@dataclass(frozen=True)
class Kept:
    """A file that was written for a person."""

    path: Path
    note: str = ""
    """What else became of it; "" = nothing."""

    @property
    def words(self) -> str:
        """Where it is."""
        return f"{self.path}; {self.note}" if self.note else str(self.path)


def asked_by(client_id: int | None, command: c.Command) -> c.Command:
    """The command as it comes from one browser: an export knows which, anything else is the same for all."""
    return replace(command, client=client_id) if isinstance(command, c.Export) else command


def downloaded(server: viser.ViserServer, client_id: int | None, path: Path) -> str:
    """Sends a file to the browser that asked for it, and to no other; says so, or why not.

    Args:
        server: that the browser looks at.
        client_id: which one it is; None = it was asked for in another way, and nothing is said.
        path: the file.
    """
    clients = {} if client_id is None else server.get_clients()
    client = clients.get(client_id) if client_id is not None else None
    if client is None:
        return ""
    size = path.stat().st_size
    if size > LARGEST_BYTES:
        return (
            f"its {size / 1e6:,.0f} MB are too many to download in the browser (at most "
            f"{LARGEST_BYTES / 1e6:,.0f} MB): copy it from there"
        )
    client.send_file_download(path.name, path.read_bytes(), PART_BYTES, save_immediately=True)
    return f"{'your browser' if len(clients) == 1 else 'the browser that asked'} downloads it too"
