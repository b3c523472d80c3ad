"""A worker process: builds a session's tools once, then solves the frames it is given; it may get another session."""

from __future__ import annotations

import os
import threading
from multiprocessing import connection, parent_process
from pathlib import Path
from typing import TYPE_CHECKING

from verefine_viz.core.settings import Session

if TYPE_CHECKING:  # It imports numpy and numba, which must wait.
    from verefine_viz.batch.tasks import TaskName

ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def work(channel: connection.Connection, session: Session, out: Path, task: TaskName) -> None:
    """The process's main: receives frames or another (session, out), sends results, until the channel closes.

    Before a result it may send a word on what takes long meanwhile.
    """
    # One frame per core beats several threads in one frame. Must be set before numpy and numba are imported.
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    threading.Thread(target=_end_with_parent, daemon=True).start()

    from verefine_viz.batch.tasks import task_named
    from verefine_viz.core.progress_token import ProgressToken
    from verefine_viz.session.kernel_compilation import COMPILING, compiling_reported
    from verefine_viz.session.toolbox import Toolbox

    progress = ProgressToken(report_once=channel.send)
    toolbox, run = Toolbox(session, progress), task_named(task)
    try:
        with compiling_reported(lambda: channel.send(COMPILING)):
            while True:
                given = channel.recv()
                if isinstance(given, str):
                    channel.send(run(toolbox, given, out))
                else:
                    session, out = given
                    toolbox = Toolbox(session, progress)
    except (EOFError, BrokenPipeError):
        return


def _end_with_parent() -> None:
    """A worker whose parent was killed must not go on writing into a folder that a new run may be using."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
