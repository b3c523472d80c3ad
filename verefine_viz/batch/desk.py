"""What stands on each worker of a Dask cluster: the session's tools, in a thread of their own.

This is the other side of ``batch/cluster.py``; frames are solved by the same function as on this machine.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numba
from distributed import Worker, WorkerPlugin, get_worker

import verefine_viz
from verefine_viz.batch.tasks import TaskName, task_named
from verefine_viz.core.errors import UnavailableError, unknown
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.patience import ENDLESS, Patience
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.session.toolbox import Toolbox


@dataclass(frozen=True)
class Answer:
    """What comes back for a frame."""

    result: str
    """A :class:`FrameResult` as JSON."""
    files: dict[str, bytes]
    """Shipped frames: what it would have written into the folder of the batch, by relative path."""


@dataclass
class Shipped:
    """A scene source with the one frame that was sent."""

    problems: dict[str, Problem]
    notes: tuple[str, ...] = ()

    @property
    def frames(self) -> tuple[str, ...]:
        return tuple(self.problems)

    def problem(self, frame: str, patience: Patience = ENDLESS) -> Problem:
        if frame not in self.problems:
            raise UnavailableError(unknown("frame", frame, self.problems))
        return self.problems[frame]


class Desk(WorkerPlugin):
    """The tools of one batch on a worker, made for its first frame. Tasks take turns: tools belong to one thread."""

    def __init__(
        self, name: str, session: Session, out: Path, task: TaskName, must_see: tuple[str, ...], version: str
    ) -> None:
        self.name = name
        """Of the plugin and of the executor that its tasks ask for."""
        self._session = session.model_dump_json()
        self._out, self._must_see, self._version = str(out), must_see, version
        self._task: TaskName = task
        self.models: dict[int, ObjectModel] = {}
        """Shipped ones, by object id."""

    def setup(self, worker: Worker) -> None:
        """Checks that this worker can do it.

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
                f"worker {worker.address} does not see {unseen[0]}; put it on storage that all machines share, "
                "or send the frames with --ship"
            )
        worker.executors[self.name] = ThreadPoolExecutor(1, initializer=_one_thread)

    def teardown(self, worker: Worker) -> None:
        executor = worker.executors.pop(self.name, None)
        if executor is not None:
            executor.shutdown(wait=False)

    @cached_property
    def toolbox(self) -> Toolbox:
        return Toolbox(Session.model_validate_json(self._session))

    def solve(self, frame: str) -> Answer:
        """A frame that is read, and whose recording is written, by path."""
        result = task_named(self._task)(self.toolbox, frame, Path(self._out))
        return Answer(result.model_dump_json(), {})

    def solve_shipped(self, frame: str, problem: Problem) -> Answer:
        """A frame that was sent."""
        models = {i.obj_id: self.models[i.obj_id] for i in problem.instances}
        self.toolbox.__dict__["source"] = Shipped({frame: replace(problem, models=models)})
        with tempfile.TemporaryDirectory(prefix="verefine-viz-") as folder:
            out = Path(folder)
            (out / "recordings").mkdir()
            result = task_named(self._task)(self.toolbox, frame, out)
            files = {f.relative_to(out).as_posix(): f.read_bytes() for f in out.rglob("*") if f.is_file()}
        return Answer(result.model_dump_json(), files)


class ModelOnDesk(WorkerPlugin):
    """Puts a model on a desk that is already there; it is sent once per worker, also to those that join later."""

    def __init__(self, desk: str, obj_id: int, model: ObjectModel) -> None:
        self.name = f"{desk}-model-{obj_id}"
        self._desk, self._obj_id, self._model = desk, obj_id, model

    def setup(self, worker: Worker) -> None:
        desk: Any = worker.plugins[self._desk]
        desk.models[self._obj_id] = self._model


def solve_at_desk(desk: str, frame: str, problem: Problem | None) -> Answer:
    """The task of a frame: ``problem`` without its models where it was sent, None where it is read by path."""
    there: Any = get_worker().plugins[desk]
    return there.solve(frame) if problem is None else there.solve_shipped(frame, problem)


def _one_thread() -> None:
    # One frame per core beats several threads in one frame.
    numba.set_num_threads(1)
