"""The session's tools on each worker of a Dask cluster, in a thread of their own: the other side of ``cluster.py``."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numba
from distributed import Worker, WorkerPlugin, get_worker

import verefine_viz
from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord
from verefine_viz.run.toolbox import Toolbox


class WorkerTools(WorkerPlugin):
    """The tools of one batch on a worker, made for its first frame. Tasks take turns: tools belong to one thread."""

    def __init__(
        self, name: str, session: Session, out: Path, task: TaskName, must_see: tuple[str, ...], version: str
    ) -> None:
        self.name = name
        """Name of the plugin and of the executor that its tasks ask for."""
        self._session = msgspec.json.encode(session)
        self._out, self._must_see, self._version = str(out), must_see, version
        self._task: TaskName = task

    def setup(self, worker: Worker) -> None:
        """Checks that this worker can solve the batch's frames.

        Raises:
            UnavailableError: another version is installed, or it does not see a path.
        """
        if verefine_viz.__version__ != self._version:
            raise UnavailableError(
                f"worker {worker.address} has verefine-viz {verefine_viz.__version__}, this is {self._version}; "
                "install the same version there"
            )
        unseen = [path for path in self._must_see if not Path(path).exists()]
        if unseen:
            raise UnavailableError(
                f"worker {worker.address} does not see {unseen[0]}; put it on storage that all machines share"
            )
        worker.executors[self.name] = ThreadPoolExecutor(1, initializer=_one_thread)

    def teardown(self, worker: Worker) -> None:
        executor = worker.executors.pop(self.name, None)
        if executor is not None:
            executor.shutdown(wait=False)

    @cached_property
    def toolbox(self) -> Toolbox:
        return Toolbox(msgspec.json.decode(self._session, type=Session))

    def solve(self, frame: str) -> RunRecord:
        """The record of a frame without its iterations; its files are written by path."""
        # The client imports this module too, and solves nothing.
        from verefine_viz.batch.solve_frame import TASKS

        return TASKS[self._task](self.toolbox, frame, Path(self._out))


def solve_on_worker(tools: str, frame: str) -> RunRecord:
    """Solves a frame with the plugin ``tools`` of the worker that got it."""
    plugin: Any = get_worker().plugins[tools]
    return plugin.solve(frame)


def _one_thread() -> None:
    # One frame per core beats several threads in one frame.
    numba.set_num_threads(1)
