"""A worker process: makes the tools of a work once, then solves items of it; another work may follow.

This module must not import numpy or numba, which read the number of threads when they are imported. A work comes
through the channel, so that its imports happen after the number of threads is set.
"""

from __future__ import annotations

import os
import signal
from multiprocessing import connection

from verefine_viz.batch.worker_tasks import ONE_THREAD
from verefine_viz.core.child_process import end_with_parent


def work(channel: connection.Connection) -> None:
    """The process's main: receives works and items, sends results, until the channel closes.

    A message is (work, item). The item is None where it follows later, the work where it is the one of the message
    before. Ahead of a result the worker may send a sentence that says what takes long.
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
