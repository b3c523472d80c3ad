"""Causes in the search: starved hypotheses, a budget too small, the refiner and its range, a bad pool."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.problem import Hypothesis
from verefine_viz.core.records import Best
from verefine_viz.diagnosis import lost_poses, score_causes, signs
from verefine_viz.diagnosis.case import ALONE, FAR, Case, Pools, Rerun
from verefine_viz.diagnosis.input_causes import likely_unit
from verefine_viz.diagnosis.number_words import distinct_texts, instead, share
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.evaluation.rotation_errors import turning_on
from verefine_viz.refiners.registry import make_refiner

ICP = "icp"
"""The refiner that others are measured against."""


WELL_WITHIN = 0.5
"""Share of the trained range into which starts are brought: near its border a refiner may fail too."""


def out_of_range(case: Case) -> Finding | None:
    """Finds all starts further from the ground truth than the refiner was trained for; decided by a re-run from well
    inside that range.
    """
    seen = signs.out_of_range(case.lab.refiner, case.target, case.lab.traits.first_only)
    if seen is None:
        return None
    trained, starts = seen
    brought = case.with_pool(*(start.brought_within(trained, WELL_WITHIN) for start in starts))
    what = "brought into the trained range"
    if case.group:
        again = case.rerun_together(what, {case.instance_id: brought.instance.hypotheses})
    else:
        again = case.rerun(what, brought)
    if not again.repaired:
        return None
    j = int(np.argmin(case.initial_errors[: len(starts)]))
    nearest, farthest_mm = starts[j], starts[j].largest_shift_mm(trained)
    name = case.lab.toolbox.session.method.refiner
    return Finding(
        Cause.OUT_OF_RANGE,
        f"The {case.name} starts {nearest.rotation_deg:.0f}° and {nearest.shift_mm:.0f} mm off (hypothesis {j + 1}, "
        f"the nearest); {name} was trained up to {trained.rotation_deg:.0f}° and {farthest_mm:.0f} mm. From half of "
        f"that range {instead(again.error, case.error)}.",
        {
            "hypotheses": float(len(starts)),
            "nearest": float(j),
            "nearest_error": float(case.initial_errors[j]),
            "nearest_rotation_deg": nearest.rotation_deg,
            "nearest_shift_mm": nearest.shift_mm,
            "trained_rotation_deg": trained.rotation_deg,
            "trained_shift_mm": farthest_mm,
            "error": case.error,
            "error_repaired": again.error,
        },
        True,
        again.what,
    )


def refiner(case: Case) -> Finding | None:
    """Finds that the refiner led the object astray, or fails on hypotheses from which ICP reaches the ground truth."""
    return _astray(case) or _beaten_by_icp(case)


def _astray(case: Case) -> Finding | None:
    """Finds that the answer is worse than a pose that it came from, by refinement."""
    lost = lost_poses.lost(case.own, case.answer, case.error_of, FAR) if case.answer is not None else None
    if lost is None or case.answer is None or lost.added_by_refiner <= lost.added_by_simulation:
        return None
    where = "it started" if lost.iteration == 0 else f"after iteration {lost.iteration} it was"
    return Finding(
        Cause.REFINER,
        f"The refiner led the {case.name} astray: {where} {share(lost.error)} of the diameter from the ground truth "
        f"(hypothesis {case.answer.arm + 1}), and ended {share(case.error)} away.",
        {
            "hypothesis": float(case.answer.arm),
            "best_iteration": float(lost.iteration),
            "error_before": lost.error,
            "error": case.error,
            "added_by_refiner": lost.added_by_refiner,
            "added_by_simulation": lost.added_by_simulation,
        },
        True,
    )


def _beaten_by_icp(case: Case) -> Finding | None:
    """Finds that the refiner fails where ICP does not; decided by a re-run with ICP from the same hypotheses."""
    session = case.lab.toolbox.session
    name = session.method.refiner
    if name == ICP or case.lab.traits.has_tree or not len(case.initial_errors):
        return None
    if case.group and case.rerun(ALONE).repaired:  # Alone, the object comes right with this refiner.
        return None
    method = case.lab.method(case.lab.simulator, make_refiner(ICP, session))
    again = case.rerun("ICP", method=method)
    if not again.repaired:
        return None
    n_calls, n_away = _calls(case)
    what = f"The refiner {name} does not bring the {case.name} to the ground truth"
    if 2 * n_away > n_calls:
        what += f" and took it further away in {n_away} of {n_calls} calls"
    return Finding(
        Cause.REFINER,
        f"{what}; with ICP from the same hypotheses {instead(again.error, case.error)}.",
        {
            "calls": float(n_calls),
            "calls_that_took_it_away": float(n_away),
            "error": case.error,
            "error_repaired": again.error,
        },
        True,
        again.what,
    )


def _calls(case: Case) -> tuple[int, int]:
    """Number of refiner calls, and of those that took the object further from ground truth."""
    changes = [
        case.error_of(after.T_cam_obj) - case.error_of(before.T_cam_obj)
        for iteration in case.own
        for before, after in pairwise(iteration.stages)
        if after.name == "refined"
    ]
    return len(changes), sum(change > 0 for change in changes)


STARVED = 0.5
"""Share of an even split of the budget below which a hypothesis was starved."""
TRIED_ALONE = 3
"""Most hypotheses that are tried with the whole budget, the nearest first."""
MULTIPLES = (2, 4, 8)
"""Budgets to try, in multiples of the run's; for a tree search, or without a sign of improvement, only the first."""
IMPROVING = 0.004
"""A hypothesis is still improving if its last iteration took more than this off the error (share of the diameter)."""


def starved(case: Case) -> Finding | None:
    """Finds a hypothesis that got few iterations and comes out right when it gets them all."""
    pulls = np.bincount([i.arm for i in case.own], minlength=len(case.initial_errors))
    if len(pulls) < 2:
        return None
    fair = len(case.own) / len(pulls)
    for j in np.argsort(case.initial_errors)[:TRIED_ALONE].tolist():
        if pulls[j] >= STARVED * max(fair, 1) or case.initial_errors[j] > FAR:
            continue
        own = case.lab.method(case.lab.simulator)
        each = own.iterations * (1 if case.lab.traits.first_only else len(pulls))
        again = case.rerun(
            f"all on hypothesis {j + 1}",
            case.with_pool(case.target.instance.hypotheses[j].T_cam_obj),
            method=case.lab.method(case.lab.simulator, iterations=each),
        )
        if again.repaired and case.group:
            again = case.rerun_together(f"all on hypothesis {j + 1}", _only_hypothesis(case, j), iterations=each)
        # Alone it wins without a rival: an answer with a higher score would have won anyway.
        if again.repaired and not case.group and not case.lab.traits.first_only and _is_outscored(case, again.best):
            continue
        if again.repaired:
            got = f"got {pulls[j]} of {len(case.own)} iterations"
            if case.lab.traits.first_only:
                got = f"was never tried, as {case.lab.name.upper()} looks at the first only"
            return Finding(
                Cause.ARM_STARVED,
                f"Hypothesis {j + 1} of the {case.name} {got}; "
                f"with the whole budget {instead(again.error, case.error)}.",
                {
                    "hypothesis": float(j),
                    "iterations_of_it": float(pulls[j]),
                    "iterations": float(len(case.own)),
                    "initial_error_of_it": float(case.initial_errors[j]),
                    "error": case.error,
                    "error_repaired": again.error,
                },
                True,
                again.what,
            )
    return None


def _only_hypothesis(case: Case, j: int) -> Pools:
    """One hypothesis alone, and of each object solved together with it the one that its answer came from."""
    pools: dict[int, Sequence[Hypothesis]] = {}
    answers = case.trace.best_at(case.trace.length)
    for i in case.group:
        pool = case.trace.problem.target(i).instance.hypotheses
        chosen = answers[i].arm if i in answers else 0
        pools[i] = pool[chosen : chosen + 1] or pool
    return pools | {case.instance_id: case.target.instance.hypotheses[j : j + 1]}


def budget(case: Case) -> Finding | None:
    """Finds that the answer's hypothesis was still improving at the end and comes out right with a larger budget.

    For objects solved together this is also tested where the object alone, with its share, comes out right.
    """
    accepted = _accepted(case)
    falling = accepted[-2] - accepted[-1] if len(accepted) > 1 and accepted[0] <= FAR else 0.0
    still = f"The {case.name} was still getting closer, by {falling:.1%} of the diameter in the last iteration"
    multiples = MULTIPLES
    if falling < IMPROVING:
        if not case.group or not case.rerun(ALONE).repaired:
            return None
        still = f"The search for the {case.name}, whose scene {len(case.group)} objects share, ended too early"
        multiples = MULTIPLES[:1]
    elif case.lab.traits.has_tree:
        multiples = MULTIPLES[:1]
    for times in multiples:
        again = _with_budget(case, times)
        if again.repaired:
            return Finding(
                Cause.BUDGET,
                f"{still}; with {times} × the budget {instead(again.error, case.error)}.",
                {"falling": falling, "times": float(times), "error": case.error, "error_repaired": again.error},
                True,
                again.what,
            )
    return None


def _with_budget(case: Case, times: int) -> Rerun:
    what = f"{times} × the budget"
    if case.group:
        return case.rerun_together(what, {}, times)
    own = case.lab.method(case.lab.simulator)
    return case.rerun(what, method=case.lab.method(case.lab.simulator, iterations=times * own.iterations))


def _is_outscored(case: Case, other: Best | None) -> bool:
    """Whether the answer scores more than another pose."""
    return other is not None and case.answer is not None and case.answer.score.score > other.score.score


CONVERGED = 20
"""Refiner calls, without simulation in between, after which it makes no further progress."""
TRIED_TO_CONVERGE = 10
"""Most hypotheses that are refined in this way, the nearest first."""


def leads_there(case: Case) -> Finding | None:
    """Finds a hypothesis that the refiner alone takes to the ground truth, and why the run did not answer with it."""
    if case.group:
        return None
    pulls = np.bincount([i.arm for i in case.own], minlength=len(case.initial_errors))
    for j in np.argsort(case.initial_errors)[:TRIED_TO_CONVERGE].tolist():
        reached = _refined_alone(case, case.target.instance.hypotheses[j].T_cam_obj)
        if reached is None:
            continue
        T, calls = reached
        # A pose that has just become correct may still improve.
        at_end = max(score_causes.scored(case, score_causes.polished(case, T)), key=lambda one: one.score)
        evidence = {
            "hypothesis": float(j),
            "calls": float(calls),
            "iterations_of_it": float(pulls[j]),
            "score_of_correct": at_end.score,
            "error": case.error,
            "error_repaired": case.error_of(T),
        }
        what = f"Refined alone, hypothesis {j + 1} of the {case.name} is correct after {calls} call{'s' * (calls > 1)}"
        if case.answer is not None and case.lab.traits.verifies and case.answer.score.score > at_end.score:
            scores = distinct_texts(at_end.score, case.answer.score.score, 3)
            sentence = f"{what}, but scores {scores[0]} at most, less than the answer, which is wrong: {scores[1]}."
            return Finding(Cause.DISCARDED, sentence, evidence | {"score": case.answer.score.score}, True)
        if pulls[j] < calls:
            sentence = f"{what}; it got {pulls[j]} of {len(case.own)} iterations."
            return Finding(Cause.ARM_STARVED, sentence, evidence, True)
        sentence = f"{what}; simulated before each call, as in the run, it was not in {pulls[j]}."
        return Finding(Cause.SIMULATION, sentence, evidence, case.lab.traits.simulates)
    return None


def _refined_alone(case: Case, T_cam_obj: Float) -> tuple[Float, int] | None:
    """The first correct pose that the refiner alone reaches from a pose, and after how many calls; None if it fails."""
    T = T_cam_obj
    for calls in range(1, CONVERGED + 1):
        before, T = T, case.lab.refiner.refine(case.target, T, case.placed)
        if case.error_of(T) < case.threshold:
            return T, calls
        if np.abs(T - before).max() < 1e-6:
            break
    return None


def no_hypothesis(case: Case) -> Finding:
    """Finds that the pool is empty, so that nothing was run."""
    again = _from_gt(case)
    what = f"There is no hypothesis for the {case.name}"
    if again.best is not None and again.best.iteration:
        what += f"; started at the ground truth, it ends {share(again.error)} of the diameter away"
    return Finding(Cause.NO_HYPOTHESIS, f"{what}.", {"hypotheses": 0.0, "error_from_ground_truth": again.error}, True)


def pool(case: Case) -> Finding | None:
    """Finds that no hypothesis leads to the ground truth, while ground truth as a start does."""
    if _beaten_by_icp(case) is not None:
        return None
    if case.group and case.rerun(ALONE).repaired:
        alone = case.rerun(ALONE)
        return Finding(
            Cause.BUDGET,
            f"The search missed the {case.name}, also with {MULTIPLES[0]} × the budget; with RIR from the same "
            f"hypotheses, among the placed objects, {instead(alone.error, case.error)}.",
            {"times": float(MULTIPLES[0]), "error": case.error, "error_alone": alone.error},
            False,
        )
    again = _from_gt(case)
    j = int(np.argmin(case.initial_errors))
    nearest = float(case.initial_errors[j])
    far = pose_errors(case.target.model, case.target.instance.hypotheses[j].T_cam_obj, case.T_gt)
    evidence = {
        "hypotheses": float(len(case.initial_errors)),
        "nearest": float(j),
        "nearest_error": nearest,
        "nearest_rotation_deg": far.rotation_deg,
        "nearest_translation_mm": far.translation_mm,
        "error": case.error,
        "error_from_ground_truth": again.error,
    }
    if again.error >= case.threshold:
        sentence = f"Even started at the ground truth, the {case.name} ends {share(again.error)} of the diameter away."
        return Finding(Cause.REFINER, sentence, evidence, False)
    if nearest < case.threshold:
        sentence = (
            f"Hypothesis {j + 1} of the {case.name} started {share(nearest)} of the diameter from the ground truth, "
            f"and refinement lost it: the error is {share(case.error)}."
        )
        return Finding(Cause.REFINER, sentence, evidence, False)
    T_nearest = case.target.instance.hypotheses[j].T_cam_obj
    way = turning_on(case.target, T_nearest)
    direction = f" ({way.describe(0)})" if way is not None else ""
    unit = likely_unit(T_nearest, case.T_gt, case.target.model.diameter_m)
    wrong = f"; its translation looks like {unit} where millimetres are expected" if unit else ""
    return Finding(
        Cause.POOL,
        f"No hypothesis of the {case.name} leads to the ground truth: the nearest of {len(case.initial_errors)} "
        f"(hypothesis {j + 1}) starts {far.rotation_deg:.0f}°{direction} and {far.translation_mm:.0f} mm away{wrong}"
        f"{_started_at_gt(case, again)}.",
        evidence,
        True,
    )


def _started_at_gt(case: Case, again: Rerun) -> str:
    """Words for the result of a re-run from ground truth; empty where it answers with the start itself."""
    if again.best is None or again.best.iteration == 0:
        return ""
    return f"; started at the ground truth {instead(again.error, case.error)}"


def _from_gt(case: Case) -> Rerun:
    return case.rerun("started at ground truth", case.with_pool(case.T_gt))


def _accepted(case: Case) -> list[float]:
    """Errors of the accepted poses of the answer's hypothesis, iteration by iteration, its start first."""
    if case.answer is None or case.answer.arm >= len(case.initial_errors):
        return []
    accepted = [case.error_of(i.accepted_stage.T_cam_obj) for i in case.own if i.arm == case.answer.arm]
    return [float(case.initial_errors[case.answer.arm]), *accepted]


SEARCH_TESTS: tuple[Callable[[Case], Finding | None], ...] = (starved, budget, out_of_range, refiner, leads_there, pool)
