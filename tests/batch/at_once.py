"""Workers that answer at once: for the loop of a batch, which does not look into answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.made_runs import answer, finished, written
from verefine_viz.batch.pace import Pace
from verefine_viz.batch.run_batch import Backend, Workers
from verefine_viz.batch.runs import file_stem
from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord, failed_run


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
    return failed_run(Session(), frame, message)


@dataclass
class AtOnce:
    """The workers."""

    answer: Callable[[str], RunRecord | str | None] = solved
    needs: str = ""
    warning: str = ""
    is_closed: bool = False
    leaves_recordings: bool = True
    """Empty files, a frame each."""
    out: Path = Path()
    """Folder of the batch."""

    def solve(self, frames: Iterable[str], pace: Pace) -> Iterator[RunRecord | str | None]:
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
