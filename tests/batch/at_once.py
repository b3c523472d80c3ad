"""Workers that answer at once: for the loop of a batch, which does not look into answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from tests.made_runs import answer, finished, written
from verefine_viz.batch import run_batch as run_batch_module
from verefine_viz.batch.run_batch import Backend, BatchOutcome, BatchStatus, Workers, run_batch
from verefine_viz.batch.runs import file_stem
from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_header import failed_run


def solved(frame: str) -> RunRecord:
    """Five objects."""
    im_id = int(frame.partition("/")[2])
    rows = [
        answer(0, im_id, instance_id=k, obj_id=1, score=0.5, T_cam_obj=np.eye(4), events="arm_switched 3; score_fell 1")
        for k in range(5)
    ]
    return finished(frame, rows, seconds=0.1)


def failed(frame: str, message: str) -> RunRecord:
    """Nobody knows what is in it."""
    return failed_run(Session(), {}, frame, message)


Answers = Callable[[str], RunRecord | str | None]


@dataclass
class AtOnce:
    """The workers."""

    answer: Answers = solved
    needs: str = ""
    warning: str = ""
    is_closed: bool = False
    leaves_recordings: bool = True
    """Empty files, a frame each."""
    out: Path = Path()
    """Folder of the batch."""

    def solve(self, frames: Iterable[str]) -> Iterator[RunRecord | str | None]:
        return map(self.done, frames)

    def done(self, frame: str) -> RunRecord | str | None:
        """The answer, with what real workers write: run files of frames that did not fail, and recordings."""
        answer = self.answer(frame)
        if isinstance(answer, RunRecord) and not (answer.end and answer.end.failed):
            written(self.out, answer)
        if self.leaves_recordings:
            (self.out / "recordings").mkdir(parents=True, exist_ok=True)
            (self.out / "recordings" / f"{file_stem(frame)}.rrd").touch()
        return answer

    def close(self) -> None:
        self.is_closed = True


@dataclass(frozen=True)
class AtOnceBackend(Backend):
    """Where they are."""

    made: AtOnce = field(default_factory=AtOnce)

    def workers(self, session: Session, out: Path, task: TaskName) -> Workers:
        self.made.out = out
        return self.made


@dataclass
class Loop:
    """A batch of made-up frames; what the last call of ``run`` asked its workers for, and told."""

    out: Path
    patch: pytest.MonkeyPatch
    asked: list[str] = field(default_factory=list)
    seen: list[BatchStatus] = field(default_factory=list)

    def frames(self, n: int, *notes: str) -> tuple[str, ...]:
        """The frames of the session from now on."""
        names = tuple(f"0/{k}" for k in range(n))
        self.patch.setattr(run_batch_module, "check", lambda session: (names, notes))
        return names

    def run(self, answer: Answers = solved, retry_failed: bool = False, workers: AtOnce | None = None) -> BatchOutcome:
        self.asked, self.seen = [], []
        workers = workers or AtOnce(lambda frame: self.asked.append(frame) or answer(frame))
        backend = AtOnceBackend(made=workers)
        return run_batch(Session(), self.out, backend, self.seen.append, retry_failed=retry_failed)

    @property
    def told(self) -> list[str]:
        return [now.doing for now in self.seen if now.doing]
