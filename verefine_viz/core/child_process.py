"""Processes that this program starts, and what they do when it is killed."""

from __future__ import annotations

import os
import threading
from multiprocessing import connection, parent_process


def end_with_parent() -> None:
    """Have this process end at once when its parent does, however that ended.

    A worker whose parent was killed must not go on writing into a folder that a new run may be using.
    """
    threading.Thread(target=_wait, daemon=True).start()


def _wait() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
