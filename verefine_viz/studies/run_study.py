"""Runs a study in worker processes; stopped or killed, the same call goes on where it was."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path

from verefine_viz.batch.worker_pool import interrupts_ignored
from verefine_viz.core.errors import InputError, SettingsError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.session.toolbox import Toolbox
from verefine_viz.studies.ablation import ablation, robustness
from verefine_viz.studies.journal import Journal
from verefine_viz.studies.paper_tables import tables
from verefine_viz.studies.solve_unit import Outcome, Solver
from verefine_viz.studies.study_plan import Study, Unit

# The studies by name.

STUDIES = ("ablation", "robustness", "tables")


@dataclass(frozen=True)
class Wanted:
    """Which study; small and plain, so that every worker can build the same."""

    name: str
    quick: bool = False
    keep_pools: bool = False

    def study(self) -> Study:
        """The study.

        Raises:
            SettingsError: there is none of this name.
        """
        if self.name == "ablation":
            return ablation(self.quick)
        if self.name == "robustness":
            return robustness(self.quick)
        if self.name == "tables":
            return tables(self.quick, self.keep_pools)
        raise SettingsError(unknown("study", self.name, STUDIES))


Tell = Callable[[int, int], None]
"""(units done, units in all)."""
_solver: list[Solver] = []
"""In a worker process: its solver, made once."""


def units_of(study: Study, frames: Mapping[str, tuple[str, ...]], seeds: int) -> list[Unit]:
    """Every frame of every scene, at every x of every panel, once per seed."""
    return [
        Unit(panel.name, x, seed, scene, frame)
        for seed in range(seeds)
        for scene, of_scene in frames.items()
        for frame in of_scene
        for panel in study.panels
        for x in panel.xs
    ]


def run_study(
    wanted: Wanted, sessions: Mapping[str, Session], seeds: int, workers: int, journal_path: Path, tell: Tell
) -> list[Outcome]:
    """All outcomes, in the same order whatever the number of workers.

    Args:
        wanted: which study.
        sessions: scenes by name, with the settings that the study leaves alone.
        seeds: how many disturbances of each frame.
        workers: processes; 1 = none but this one.
        journal_path: what is done so far.
        tell: is told the progress.

    Raises:
        VerefineError: a session, a frame or the journal cannot be used.
    """
    frames = {name: Toolbox(session).frames for name, session in sessions.items()}
    study = wanted.study()
    units = units_of(study, frames, seeds)
    about = {
        "wanted": asdict(wanted),
        "sessions": {name: session.model_dump(mode="json") for name, session in sessions.items()},
    }
    journal = Journal(journal_path, about)
    try:
        left = [unit for unit in units if unit not in journal.done]
        tell(len(units) - len(left), len(units))
        if workers == 1:
            solver = Solver(sessions, study.panels)
            for k, unit in enumerate(left, start=1):
                journal.add(unit, solver.solve(unit))
                tell(len(units) - len(left) + k, len(units))
        elif left:
            _in_parallel(wanted, sessions, left, len(units), workers, journal, tell)
        asked = set(units)  # an earlier call may have had more seeds
        return [o for o in journal.outcomes() if Unit(o.panel, o.x, o.seed, o.scene, o.frame) in asked]
    finally:
        journal.close()


def _in_parallel(
    wanted: Wanted,
    sessions: Mapping[str, Session],
    left: list[Unit],
    n_units: int,
    workers: int,
    journal: Journal,
    tell: Tell,
) -> None:
    context = multiprocessing.get_context("spawn")
    others = multiprocessing.active_children()
    with ProcessPoolExecutor(min(workers, len(left)), context, _start, (dict(sessions), wanted)) as pool:
        try:
            with interrupts_ignored():
                found: dict[Future[list[Outcome]], Unit] = {pool.submit(_solve, unit): unit for unit in left}
            for k, future in enumerate(as_completed(found), start=1):
                journal.add(found[future], future.result())
                tell(n_units - len(left) + k, n_units)
        except BrokenProcessPool:
            raise InputError("a worker process was killed (out of memory?); the same command goes on") from None
        except BaseException:
            # Units that were begun may take long; what is done is in the journal. The pool, left without its workers,
            # is waited for: its thread, still closing down while the interpreter ends, made a traceback of Ctrl-C.
            for worker in set(multiprocessing.active_children()).difference(others):
                worker.kill()
            raise


def _start(sessions: Mapping[str, Session], wanted: Wanted) -> None:
    _solver.append(Solver(sessions, wanted.study().panels))


def _solve(unit: Unit) -> list[Outcome]:
    return _solver[0].solve(unit)
