"""A worker process: builds a session's tools once, then solves the frames it is given; it may get another session.

This module must not import numpy or numba, which read the number of threads when they are imported.
"""

from __future__ import annotations

import os
import signal
import threading
from multiprocessing import connection, parent_process
from pathlib import Path

from verefine_viz.batch.worker_tasks import ONE_THREAD, TaskName
from verefine_viz.core.settings import Session


def work(channel: connection.Connection, session: Session, out: Path, task: TaskName) -> None:
    """The process's main: receives frames or another (session, out), sends results, until the channel closes.

    Before a result it may send a sentence on what is taking long.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent ends it.
    # One frame per core beats several threads in one frame.
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    threading.Thread(target=_end_with_parent, daemon=True).start()

    from verefine_viz.batch.solve_frame import TASKS
    from verefine_viz.core.progress_token import ProgressToken
    from verefine_viz.run.kernel_compilation import COMPILING, CompilingTurn
    from verefine_viz.run.toolbox import Toolbox

    progress = ProgressToken(report_once=channel.send)
    toolbox, solve = Toolbox(session, progress), TASKS[task]
    turn = CompilingTurn()

    def compiling() -> None:
        channel.send(COMPILING)
        turn.take()

    try:
        while True:
            received = channel.recv()
            if isinstance(received, str):
                channel.send(solve(toolbox, received, out, compiling))
                turn.end()
            else:
                session, out = received
                toolbox = Toolbox(session, progress)
    except (EOFError, BrokenPipeError):
        return


def _end_with_parent() -> None:
    """A worker whose parent was killed must not go on writing into a folder that a new run may be using."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
