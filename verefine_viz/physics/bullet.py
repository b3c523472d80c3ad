"""pybullet, without the line about its build that it writes to stderr when it is imported."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["BulletClient", "pybullet"]


@contextmanager
def _stderr_closed() -> Iterator[None]:
    """The line comes from C, so the file descriptor is what has to point elsewhere."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


with _stderr_closed():
    import pybullet
    from pybullet_utils.bullet_client import BulletClient
