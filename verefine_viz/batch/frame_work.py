"""The work of a batch: frames of one session, into one folder."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from pathlib import Path

from verefine_viz.batch.worker_tasks import TaskName
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_header import failed_run
from verefine_viz.run.session_parts import weights_of


@dataclass(frozen=True)
class FrameWork:
    """The work of solving frames: see :class:`verefine_viz.batch.worker_tasks.Work`."""

    session: Session
    out: Path
    """The batch folder."""
    task: TaskName = "solve"

    def begin(self, progress: ProgressToken) -> Callable[[str, Callable[[], None]], RunRecord]:
        # The parent imports this module too, and solves nothing.
        from verefine_viz.batch.solve_frame import TASKS
        from verefine_viz.run.toolbox import Toolbox

        toolbox, solve = Toolbox(self.session, progress), TASKS[self.task]
        return lambda frame, compiling: solve(toolbox, frame, self.out, compiling)

    def lost(self, item: str, why: str) -> RunRecord:
        return failed_run(self.session, weights_of(self.session), item, why)

    def line_of(self, item: str) -> Hashable:
        """The scene, where frames begin with the answers of earlier frames; else None."""
        return parse_frame(item)[0] if self.session.method.track else None
