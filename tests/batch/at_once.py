"""Workers that answer at once: for the loop of a batch, which does not look into answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tests.batch.answering import POSE

# NAMES Estimate,FrameResult,Answer,file_stem
from verefine_viz.batch.run_batch import Backend, Workers
from verefine_viz.batch.worker_process import TaskName
from verefine_viz.core.settings import Session


def solved(frame: str) -> FrameResult:
    """One object with five estimates."""
    im_id = int(frame.partition("/")[2])
    row = answer(scene_id=0, im_id=im_id, status="ok", score=0.5, events="arm_switched 3; score_fell 1" * 10)
    estimate = Estimate(obj_id=1, score=0.5, T_cam_obj=POSE)
    return FrameResult(frame=frame, failed=False, seconds=0.1, objects=(row,), estimates=(estimate,) * 5)


@dataclass
class AtOnce:
    """The workers."""

    answer: Callable[[str], FrameResult | str | None] = solved
    needs: str = ""
    warning: str = ""
    is_closed: bool = False
    recordings: Path | None = None
    """Where each frame leaves one, as those of real workers do; empty files."""

    def solve(self, frames: Iterable[str]) -> Iterator[FrameResult | str | None]:
        return map(self._recorded, frames)

    def _recorded(self, frame: str) -> FrameResult | str | None:
        answer = self.answer(frame)
        if self.recordings is not None:
            self.recordings.mkdir(parents=True, exist_ok=True)
            (self.recordings / f"{file_stem(frame)}.rrd").touch()
        return answer

    def close(self) -> None:
        self.is_closed = True


@dataclass(frozen=True)
class AtOnceBackend(Backend):
    """Where they are."""

    made: AtOnce = field(default_factory=AtOnce)

    def workers(self, session: Session, out: Path, task: TaskName) -> Workers:
        self.made.recordings = out / "recordings"
        return self.made
