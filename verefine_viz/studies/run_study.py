"""Runs a study by the workers of batches; stopped or killed, the same call goes on where it was."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import msgspec

from verefine_viz.batch.session_check import check
from verefine_viz.batch.worker_pool import Pool
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import Session
from verefine_viz.studies.solve_unit import UnitAnswer
from verefine_viz.studies.study_folder import StudyFolder, UnitResult
from verefine_viz.studies.study_plan import Study, Unit
from verefine_viz.studies.study_request import StudyRequest
from verefine_viz.studies.unit_work import UnitWork


@dataclass(frozen=True)
class StudyOutcome:
    """What a study came to, so far as it is done."""

    answers: tuple[UnitAnswer, ...]
    """In the same order whatever the number of workers."""
    failures: tuple[UnitResult, ...] = ()
    """Units that failed; the same call tries them again."""


def _units_of(study: Study, frames: Mapping[str, tuple[str, ...]], seeds: int) -> list[Unit]:
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
    out: Path,
    report: Callable[[int, int], None],
    announce: Callable[[str], None] = lambda doing: None,
) -> StudyOutcome:
    """Solves the units of a study into ``out``, those that are not there yet.

    A unit that fails before any is done ends the study, as others would fail too; a later one is left out and named.

    Args:
        request: which study.
        sessions: scenes by name, with the settings that the study leaves alone.
        seeds: how many disturbances of each frame.
        workers: most worker processes.
        out: the folder of the study; units of more seeds than now are not used.
        report: takes how many units are done, and how many there are.
        announce: gets sentences on what takes longer than usual, each once.

    Raises:
        VerefineError: a session or the folder cannot be used, or a unit fails before any is done.
    """
    units = _units(request, sessions, seeds)
    with closing(StudyFolder(out, _about(request, sessions))) as folder:
        done = {unit: result for unit in units if (result := folder.read(unit)) is not None}
        failures: dict[Unit, UnitResult] = {}
        if folder.n_unreadable:
            announce(
                f"{folder.n_unreadable} of the saved runs are damaged or of an earlier version: they are solved again"
            )
        report(len(done), len(units))
        left = [unit for unit in units if unit not in done]
        if left:
            with closing(Pool(UnitWork(request, sessions, out.absolute()), workers)) as pool:
                for result in pool.solve(left):
                    if isinstance(result, str):
                        announce(result)
                    elif result is not None and result.failure:
                        if not done:
                            raise InputError(result.failure)
                        failures[result.unit] = result
                    elif result is not None:
                        folder.save(result)
                        done[result.unit] = result
                        report(len(done), len(units))
    return StudyOutcome(_answers(done), tuple(failures[unit] for unit in sorted(failures)))


def saved_outcome(request: StudyRequest, sessions: Mapping[str, Session], seeds: int, out: Path) -> StudyOutcome:
    """What :func:`run_study` has saved where it was stopped.

    Raises:
        VerefineError: the folder cannot be used.
    """
    with closing(StudyFolder(out, _about(request, sessions))) as folder:
        units = _units(request, sessions, seeds)
        return StudyOutcome(_answers({unit: result for unit in units if (result := folder.read(unit)) is not None}))


def _answers(done: Mapping[Unit, UnitResult]) -> tuple[UnitAnswer, ...]:
    return tuple(answer for unit in sorted(done) for answer in done[unit].outcomes)


def _units(request: StudyRequest, sessions: Mapping[str, Session], seeds: int) -> Sequence[Unit]:
    return _units_of(request.study(), {name: check(session)[0] for name, session in sessions.items()}, seeds)


def _about(request: StudyRequest, sessions: Mapping[str, Session]) -> Mapping[str, object]:
    # Budgets of another version are another study.
    curves = {p.name: {c.label: c.settings for c in p.curves} for p in request.study().panels}
    return msgspec.json.decode(msgspec.json.encode({"study": request, "curves": curves, "sessions": sessions}))
