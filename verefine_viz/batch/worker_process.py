"""A worker process: makes the tools of a work once, then solves the items it is given; it may get another work.

This module must not import numpy or numba, which read the number of threads when they are imported. A work comes
through the channel, so that what it imports is imported here after that number is set.
"""

from __future__ import annotations

import os
import signal
from multiprocessing import connection

from verefine_viz.batch.worker_tasks import ONE_THREAD
from verefine_viz.core.child_process import end_with_parent


def work(channel: connection.Connection) -> None:
    """The process's main: receives works and items, sends results, until the channel closes.

    A message is a work and an item of it: no item where it comes later, no work where it is that of the last message.
    Before a result it may send a sentence on what is taking long.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent ends it.
    # One item per core beats several threads in one item.
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    end_with_parent()

    from verefine_viz.core.progress_token import ProgressToken
    from verefine_viz.run.kernel_compilation import COMPILING, CompilingTurn

    progress, turn = ProgressToken(report_once=channel.send), CompilingTurn()

    def compiling() -> None:
        channel.send(COMPILING)
        turn.take()

    solve = None
    try:
        while True:
            given, item = channel.recv()
            if given is not None:
                solve = given.begin(progress)
            if item is not None:
                assert solve is not None, "the first message has a work"
                channel.send(solve(item, compiling))
                turn.end()
    except (EOFError, BrokenPipeError):
        return
