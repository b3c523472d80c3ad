"""Finds why instances failed: a main cause for each, with numbers, by testing what would have repaired the answer.

The input is tested first (an undeclared symmetry, units, depth, mask, neighbours placed before), then the score,
the world that physics saw, and last the search. A cause counts as confirmed if the run comes out right without
it; the first confirmed one is the main cause, and only re-runs that are needed until then are made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from time import perf_counter
from typing import TYPE_CHECKING

from msgspec import structs

from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.core.accuracy import CORRECT
from verefine_viz.core.causes import CAUSES, Cause
from verefine_viz.core.doubt import texts_of
from verefine_viz.core.finding import Finding
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.records import Best, PlacedPose
from verefine_viz.diagnosis.case import ALONE, HELPS, TOGETHER, Case, Control, Lab
from verefine_viz.diagnosis.frame_ground_truth import FrameGroundTruth
from verefine_viz.diagnosis.input_causes import INPUT_TESTS, ground_truth
from verefine_viz.diagnosis.scene_causes import WORLD_TESTS, neighbour, simulation
from verefine_viz.diagnosis.score_causes import ambiguous, discarded, score
from verefine_viz.diagnosis.search_causes import SEARCH_TESTS, no_hypothesis
from verefine_viz.evaluation.pose_errors import ErrorOf
from verefine_viz.run.engine import Run

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox


def preference(case: Case) -> Finding | None:
    """Whether the score prefers the wrong answer, by more than its noise, to a ground truth that fits its image."""
    finding = score(case)
    if finding is None or ground_truth(case) is not None or ambiguous(case) is not None:
        return None
    return finding


_GIVEN = (*INPUT_TESTS, ambiguous, neighbour, preference, *WORLD_TESTS)
"""Tests of the input, which come first: how a run handles a wrong mask or plane says nothing about the run itself.
Whether the image can tell two poses apart is tested before everything that rests on a difference of scores."""
_DONE = (discarded, simulation, *SEARCH_TESTS)
"""Tests of the run itself. A correct pose that was reached comes first: then nothing that led others away decided."""
_TESTS: tuple[Callable[[Case], Finding | None], ...] = (*_GIVEN, *_DONE)
_OF_THE_SCENE = (*INPUT_TESTS[:2], ambiguous, neighbour, preference, discarded, *SEARCH_TESTS)
"""Tests where the object alone would have come right, so that no repair of its input proves anything."""
_NO_RERUN = (preference,)
"""Tests that are made even after a cause is confirmed, as they cost next to nothing."""


@dataclass(frozen=True)
class Diagnosis:
    """Why one instance failed."""

    instance_id: int
    findings: tuple[Finding, ...]
    """The main finding first, then other reasons, the likeliest first."""
    n_reruns: int
    """Re-runs on this instance that the diagnosis took."""
    ms: float = 0.0
    """Time it took [ms]."""
    doubts: tuple[str, ...] = ()
    """Doubts about the data of the frame, which may be behind the cause."""

    @property
    def main(self) -> Finding:
        return self.findings[0]


def diagnose(
    run: Run, toolbox: Toolbox, threshold: float = CORRECT, every_cause: bool = False
) -> tuple[Diagnosis, ...]:
    """Why each failed instance of a finished run failed; instances without ground truth are passed over.

    The answer depends on the arguments only, times aside. Edited poses and settings changed on the way are not repeated
    in re-runs.

    Args:
        run: the finished run.
        toolbox: the toolbox that made it.
        threshold: an answer fails if its ADD(-S) is at least this share of the diameter; an instance without answer
            fails in any case.
        every_cause: whether the other causes are tested too after the main one is confirmed.
    """
    diagnoses = [diagnosed(case, every_cause) for case in failed_cases(run, toolbox, threshold)]
    if not diagnoses:
        return ()
    # A wrong camera or unit changes all objects.
    doubts = texts_of(data_doubts(run.problem))
    return tuple(replace(one, doubts=doubts) for one in diagnoses)


def failed_cases(run: Run, toolbox: Toolbox, threshold: float = CORRECT) -> Iterator[Case]:
    """The instances that failed, for :func:`diagnosed`; the arguments are those of :func:`diagnose`."""
    frame, lab, answers = FrameGroundTruth(run.problem), Lab(toolbox), run.best_at(run.length)
    for target in run.problem.targets:
        T_gt = target.instance.T_cam_obj_gt
        answer = answers.get(target.instance.instance_id)
        if T_gt is None or (answer is not None and ErrorOf(target.model, T_gt)(answer.T_cam_obj) < threshold):
            continue
        yield Case(run, lab, target, T_gt, frame, threshold, answer, _placed(run, target, answer))


def diagnosed(case: Case, every_cause: bool = False) -> Diagnosis:
    """Why one instance failed, without the doubts about the data of its frame."""
    began, before = perf_counter(), case.lab.n_reruns
    findings: list[Finding] = []
    main: Finding | None = None
    between: Control | None = None
    for test in _tests_for(case):
        if main is not None and not every_cause and test not in _NO_RERUN:
            continue
        finding = test(case)
        if finding is not None:
            finding, control = _controlled(case, finding)
            between = between or control
            findings.append(finding)
            if main is None and finding.is_confirmed:
                main = finding
    if main is None and between is not None:
        main = _undecided(case, between)
    main = main or _likeliest(findings)
    others = sorted((f for f in findings if f is not main), key=lambda f: not f.is_confirmed)
    return Diagnosis(case.instance_id, (main, *others), case.lab.n_reruns - before, (perf_counter() - began) * 1e3)


def _controlled(case: Case, finding: Finding) -> tuple[Finding, Control | None]:
    """The finding, confirmed only if it explains clearly more than chance does; else also how often chance helped.

    A repair has to come out right more often than re-runs with nothing changed do. Where nothing is put right, as where
    no hypothesis leads to the ground truth, none of those may come out right.
    """
    if not finding.is_confirmed or not (finding.rests_on or CAUSES[Cause(finding.cause)].is_by_chance):
        return finding, None
    chance = case.unchanged(finding.rests_on or (TOGETHER if case.group else ALONE))
    if not chance.n_right:
        return finding, None
    evidence = {"reruns": float(chance.n), "reruns_right": float(chance.n_right)}
    if finding.rests_on:
        repaired = case.repeated(finding.rests_on)
        evidence |= {"repaired": float(repaired.n), "repaired_right": float(repaired.n_right)}
        if repaired.n_right / repaired.n - chance.n_right / chance.n >= HELPS:
            return structs.replace(finding, numbers={**finding.numbers, **evidence}), None
    return structs.replace(finding, numbers={**finding.numbers, **evidence}, is_confirmed=False), chance


def _undecided(case: Case, chance: Control) -> Finding:
    return Finding(
        Cause.UNDECIDED,
        f"The {case.name} is between two basins: right in {chance.n_right} of {chance.n} re-runs that differ only in "
        "which of the observed points are used, and nothing that was put right helps clearly more often.",
        {"reruns": float(chance.n), "reruns_right": float(chance.n_right), "error": case.error},
        True,
    )


def _tests_for(case: Case) -> tuple[Callable[[Case], Finding | None], ...]:
    if not case.target.instance.hypotheses:
        return (no_hypothesis,)
    return _TESTS if not _solved_alone(case) else _OF_THE_SCENE


def _solved_alone(case: Case) -> bool:
    """Whether a method of whole scenes failed on an object that comes right alone."""
    return bool(case.group) and case.answer is not None and case.rerun(ALONE).repaired


def _likeliest(findings: Sequence[Finding]) -> Finding:
    """The finding whose repair helps most, where none makes the answer right; the last test always finds a cause."""
    repairs = [f for f in findings if {"error", "error_repaired"} <= f.numbers.keys()]
    helps = [f for f in repairs if f.numbers["error_repaired"] < 0.7 * f.numbers["error"]]
    if helps:
        return min(helps, key=lambda f: f.numbers["error_repaired"])
    return findings[-1]


def _placed(run: Run, target: Target, answer: Best | None) -> tuple[Placed, ...]:
    """The other objects as they were placed before this one for its answer, or in its last iteration."""
    own, models = target.instance.instance_id, {t.instance.instance_id: t.model for t in run.problem.targets}
    worked_on = [i for i in run.iterations if i.instance_id == own or i.tree is not None]
    made_it = [i for i in worked_on if answer is not None and i.index == answer.iteration] or run.iterations_of(own)
    if not made_it:
        return ()
    last = made_it[-1]
    # A search may have placed it only after the object that the iteration was about.
    about = PlacedPose(last.instance_id, last.accepted_stage.T_cam_obj)
    scene = (*last.placed, about, *(last.tree.rollout if last.tree is not None else ()))
    before = takewhile(lambda p: p.instance_id != own, scene)
    return tuple(Placed(p.instance_id, models[p.instance_id], p.T_cam_obj) for p in before)
