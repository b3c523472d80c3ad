"""The refiner as the cause: it led the object astray, or does not get there from where ICP does."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from verefine_viz.core.records import StageName
from verefine_viz.diagnosis.case import ALONE, FAR, Case
from verefine_viz.diagnosis.causes import Cause, Finding
from verefine_viz.diagnosis.words import instead, share
from verefine_viz.refiners.registry import make_refiner

ICP = "icp"
"""The refiner that others are measured against."""
WORSE = 0.03
"""The answer is worse than a pose before by more than this share of the diameter …"""
WORSE_BY = 1.2
"""… and by more than this factor: then something led it astray."""


def refiner(case: Case) -> Finding | None:
    """The refiner led it astray, or does not get there from where ICP does."""
    return _astray(case) or outdone(case)


def _astray(case: Case) -> Finding | None:
    """The answer is worse than a pose that it came from, and refinement made it so."""
    track = _track(case)
    if len(track) < 2 or case.answer is None:
        return None
    best = min(range(len(track)), key=lambda k: track[k].error)
    before, at_end = track[best], case.error
    if before.error > FAR or at_end - before.error < WORSE or at_end < WORSE_BY * before.error:
        return None
    lost = {"refined": 0.0, "simulated": 0.0}
    for a, b in pairwise(track[best:]):
        by = "simulated" if b.stage in ("simulated", "mixed") else "refined"
        lost[by] += max(b.error - a.error, 0.0)
    if lost["refined"] <= lost["simulated"]:
        return None
    where = "It started" if before.iteration == 0 else f"After iteration {before.iteration} it was"
    return Finding(
        Cause.REFINER,
        f"The refiner led the {case.name} astray: {where[0].lower()}{where[1:]} {share(before.error)} of the diameter "
        f"from the truth (hypothesis {case.answer.arm + 1}), and ended {share(at_end)} away.",
        {
            "hypothesis": float(case.answer.arm),
            "best_iteration": float(before.iteration),
            "error_before": before.error,
            "error": at_end,
            "added_by_refiner": lost["refined"],
            "added_by_simulation": lost["simulated"],
        },
        True,
    )


def outdone(case: Case) -> Finding | None:
    """Another refiner than ICP; decided by a re-run with ICP from the same hypotheses."""
    session = case.lab.toolbox.session
    name = session.method.refiner
    if name == ICP or case.lab.traits.has_tree or not len(case.initial_errors):
        return None
    if case.company and case.rerun(ALONE).repaired:  # It gets there, but for the company.
        return None
    method = case.lab.method(case.lab.simulator, make_refiner(ICP, session))
    again = case.rerun("ICP", method=method)
    if not again.repaired:
        return None
    n_calls, n_away = _calls(case)
    said = f"The refiner {name} does not bring the {case.name} to the truth"
    if 2 * n_away > n_calls:
        said += f" and took it further away in {n_away} of {n_calls} calls"
    return Finding(
        Cause.REFINER,
        f"{said}; with ICP from the same hypotheses {instead(again.error, case.error)}.",
        {
            "calls": float(n_calls),
            "calls_that_took_it_away": float(n_away),
            "error": case.error,
            "error_repaired": again.error,
        },
        True,
    )


def _calls(case: Case) -> tuple[int, int]:
    """How often the refiner was called, and how often it took the object further from the truth."""
    changes = [
        case.error_of(after.T_cam_obj) - case.error_of(before.T_cam_obj)
        for iteration in case.own
        for before, after in pairwise(iteration.stages)
        if after.name == "refined"
    ]
    return len(changes), sum(change > 0 for change in changes)


@dataclass(frozen=True)
class _Point:
    """A pose on the way to the answer."""

    error: float
    stage: StageName
    iteration: int
    """0 = the hypothesis itself."""


def _track(case: Case) -> list[_Point]:
    """The poses of the answer's hypothesis up to the answer, each made from the one before."""
    if case.answer is None or not len(case.initial_errors):
        return []
    arm = case.answer.arm
    if arm >= len(case.target.instance.hypotheses):
        return []
    track = [_Point(float(case.initial_errors[arm]), "initial", 0)]
    for iteration in case.own:
        if iteration.arm != arm or iteration.index > case.answer.iteration:
            continue
        for stage in iteration.stages[1:]:
            track.append(_Point(case.error_of(stage.T_cam_obj), stage.name, iteration.index))
    return track
