"""Runs a study in worker processes; stopped or killed, the same call goes on where it was."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from verefine_viz.batch.folder import LOCK_FILE
from verefine_viz.batch.runs import file_stem
from verefine_viz.batch.session_check import check
from verefine_viz.batch.worker_pool import interrupts_ignored
from verefine_viz.core.errors import InputError, SettingsError, UnavailableError, unknown
from verefine_viz.core.files import read_json
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import atomic, check_folder, clear_parts, try_lock, write_json
from verefine_viz.studies.ablation import ablation, robustness
from verefine_viz.studies.grasping_study import grasping
from verefine_viz.studies.paper_tables import tables
from verefine_viz.studies.solve_unit import Solver, UnitAnswer
from verefine_viz.studies.study_plan import Study, Unit

STUDIES = ("ablation", "robustness", "tables", "grasping")
STUDY_FILE = "study.json"
"""In the folder of a study's journal: which study, and the sessions of its scenes."""


@dataclass(frozen=True)
class StudyRequest:
    """Which study; small and plain, so that every worker can build the same."""

    name: str
    quick: bool = False
    own_initial_poses: bool = False
    """The tables start from the session's own initial poses instead of disturbed ground truth."""
    refiner: str = "icp"
    """The session's; the tables have it besides the paper's."""

    def study(self) -> Study:
        """
        Raises:
            SettingsError: there is no study of this name.
        """
        if self.name == "ablation":
            return ablation(self.quick, self.refiner)
        if self.name == "robustness":
            return robustness(self.quick, self.refiner)
        if self.name == "tables":
            return tables(self.own_initial_poses, self.refiner)
        if self.name == "grasping":
            return grasping(self.quick, self.own_initial_poses, self.refiner)
        raise SettingsError(unknown("study", self.name, STUDIES))


class UnitResult(msgspec.Struct, frozen=True):
    """An entry of a study's journal."""

    unit: Unit
    outcomes: tuple[UnitAnswer, ...]


class StudyJournal:
    """The finished units of a study, a file each, in a folder that this process alone writes to until :meth:`close`.

    Args:
        folder: made if it is not there.
        about: what the study is (settings, scenes), as it comes from JSON.

    Raises:
        InputError: the folder holds something else, or a study with other settings, or cannot be written.
        UnavailableError: another process is writing to it.
    """

    def __init__(self, folder: Path, about: Mapping[str, object]) -> None:
        self._folder = folder
        check_folder(folder)
        if folder.exists() and not (folder / STUDY_FILE).exists() and not self._is_new():
            raise self._no_journal()
        folder.mkdir(parents=True, exist_ok=True)
        lock = try_lock(folder / LOCK_FILE)
        if lock is None:
            raise UnavailableError(f"another study is writing to {folder}; wait for it or choose another --out")
        self._lock = lock
        try:
            self._check_study(about)
            clear_parts(folder)
        except BaseException:
            self.close()
            raise

    def read(self, unit: Unit) -> tuple[UnitAnswer, ...] | None:
        """What a unit came to; None where it is not finished, or its entry is damaged."""
        file = self._file(unit)
        with suppress(InputError):
            entry = read_json(file, UnitResult) if file.exists() else None
            if entry is not None and entry.unit == unit:
                return entry.outcomes
        return None

    def save(self, unit: Unit, outcomes: Sequence[UnitAnswer]) -> None:
        """Notes a finished unit; from now on a restart does not repeat it.

        Raises:
            InputError: the disk refuses.
        """
        with atomic(self._file(unit)) as part:
            part.write_bytes(msgspec.json.encode(UnitResult(unit, tuple(outcomes))))

    def close(self) -> None:
        """Lets others write to the folder."""
        self._lock.close()

    def _file(self, unit: Unit) -> Path:
        return self._folder / f"{unit.scene} {file_stem(unit.frame)}, {unit.panel}, {unit.x:g}, seed {unit.seed}.json"

    def _is_new(self) -> bool:
        """Whether there is nothing in the folder but what a study that was killed at its start leaves."""
        return all(file.name == LOCK_FILE or file.suffix == ".part" for file in self._folder.iterdir())

    def _check_study(self, about: Mapping[str, object]) -> None:
        file = self._folder / STUDY_FILE
        if not file.exists():
            write_json(file, about)
            return
        try:
            before = read_json(file, dict[str, Any])
        except InputError:
            raise self._no_journal() from None
        if before != about:
            raise InputError(
                f"{self._folder} belongs to a study with other settings; choose another --out, or delete it"
            )

    def _no_journal(self) -> InputError:
        return InputError(f"{self._folder} is no journal of a study; choose another --out, or delete it")


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
    request: StudyRequest,
    sessions: Mapping[str, Session],
    seeds: int,
    workers: int,
    journal_folder: Path,
    report: Callable[[int, int], None],
) -> list[UnitAnswer]:
    """All outcomes, in the same order whatever the number of workers.

    Args:
        request: which study.
        sessions: scenes by name, with the settings that the study leaves alone.
        seeds: how many disturbances of each frame.
        workers: processes; 1 = none but this one.
        journal_folder: where finished units are saved; those of more seeds than now are not used.
        report: takes how many units are done, and how many there are.

    Raises:
        VerefineError: a session, a frame or the journal cannot be used.
    """
    units = _units(request, sessions, seeds)
    with closing(StudyJournal(journal_folder, _about(request, sessions))) as journal:
        done = {unit: outcomes for unit in units if (outcomes := journal.read(unit)) is not None}
        report(len(done), len(units))
        with closing(_solved(request, sessions, [unit for unit in units if unit not in done], workers)) as results:
            for unit, outcomes in results:
                journal.save(unit, outcomes)
                done[unit] = outcomes
                report(len(done), len(units))
    return [outcome for unit in sorted(done) for outcome in done[unit]]


def saved_outcomes(
    request: StudyRequest, sessions: Mapping[str, Session], seeds: int, journal_folder: Path
) -> list[UnitAnswer]:
    """The outcomes that :func:`run_study` has saved, in the same order, where it was stopped.

    Raises:
        VerefineError: the journal cannot be used.
    """
    with closing(StudyJournal(journal_folder, _about(request, sessions))) as journal:
        units = sorted(_units(request, sessions, seeds))
        return [outcome for unit in units for outcome in journal.read(unit) or ()]


def _units(request: StudyRequest, sessions: Mapping[str, Session], seeds: int) -> list[Unit]:
    return units_of(request.study(), {name: check(session)[0] for name, session in sessions.items()}, seeds)


def _about(request: StudyRequest, sessions: Mapping[str, Session]) -> Mapping[str, object]:
    # Budgets of another version are another study.
    curves = {p.name: {c.label: c.settings for c in p.curves} for p in request.study().panels}
    return msgspec.json.decode(msgspec.json.encode({"study": request, "curves": curves, "sessions": sessions}))


def _solved(
    request: StudyRequest, sessions: Mapping[str, Session], units: Sequence[Unit], workers: int
) -> Generator[tuple[Unit, tuple[UnitAnswer, ...]]]:
    """The units as they are done; closing it in the middle ends the worker processes."""
    if workers == 1 or not units:
        solver = Solver(sessions, request.study().panels)
        for unit in units:
            yield unit, solver.solve(unit)
        return
    context = multiprocessing.get_context("spawn")
    others = multiprocessing.active_children()
    with ProcessPoolExecutor(min(workers, len(units)), context, _start, (dict(sessions), request)) as pool:
        try:
            with interrupts_ignored():
                unit_of: dict[Future[tuple[UnitAnswer, ...]], Unit] = {
                    pool.submit(_solve, unit): unit for unit in units
                }
            for future in as_completed(unit_of):
                yield unit_of[future], future.result()
        except BrokenProcessPool:
            raise InputError("a worker process was killed (out of memory?); the same command goes on") from None
        except BaseException:
            # Units that were begun may take long; what is done is in the journal. The pool, left without its workers,
            # is waited for: its thread, still closing down while the interpreter ends, made a traceback of Ctrl-C.
            for worker in set(multiprocessing.active_children()).difference(others):
                worker.kill()
            raise


_solver: list[Solver] = []
"""In a worker process: its solver, made once."""


def _start(sessions: Mapping[str, Session], request: StudyRequest) -> None:
    _solver.append(Solver(sessions, request.study().panels))


def _solve(unit: Unit) -> tuple[UnitAnswer, ...]:
    return _solver[0].solve(unit)
