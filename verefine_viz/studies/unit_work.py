"""The work of a study: its units, each solved by every curve of its panel."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from pathlib import Path

from verefine_viz.batch.failures import why_failed
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import Session
from verefine_viz.run.kernel_compilation import compiling_reported
from verefine_viz.studies.solve_unit import Solver
from verefine_viz.studies.study_folder import UnitResult
from verefine_viz.studies.study_plan import Unit
from verefine_viz.studies.study_request import StudyRequest


@dataclass(frozen=True)
class UnitWork:
    """See :class:`verefine_viz.batch.worker_tasks.Work`."""

    request: StudyRequest
    sessions: Mapping[str, Session]
    """Scenes by name, with the settings that the study leaves alone."""
    out: Path
    """Folder of the study."""

    def begin(self, progress: ProgressToken) -> Callable[[Unit, Callable[[], None]], UnitResult]:
        solver = Solver(self.sessions, self.request.study().panels, progress)

        def solve(unit: Unit, compiling: Callable[[], None]) -> UnitResult:
            try:
                with compiling_reported(compiling):
                    return UnitResult(unit, solver.solve(unit))
            except Exception as error:
                return self.lost(unit, why_failed(error, self.out, unit.stem))

        return solve

    def lost(self, item: Unit, why: str) -> UnitResult:
        return UnitResult(item, (), why)

    def line_of(self, item: Unit) -> Hashable:
        return None
