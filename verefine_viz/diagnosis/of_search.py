"""Causes that lie in the search: starved hypotheses, too small a budget, a bad pool."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from verefine_viz.core.problem import Hypothesis
from verefine_viz.diagnosis.case import ALONE, FAR, Case, Rerun
from verefine_viz.diagnosis.causes import Cause, Finding
from verefine_viz.diagnosis.of_refiner import outdone, refiner
from verefine_viz.diagnosis.together import Pools
from verefine_viz.diagnosis.units import of_another_unit
from verefine_viz.diagnosis.words import instead, share
from verefine_viz.evaluation.errors import pose_errors
from verefine_viz.evaluation.turning import turning_on

STARVED = 0.5
"""A hypothesis that got less than this share of an even split of the budget was starved."""
TRIED_ALONE = 3
"""Hypotheses that are tried with the whole budget, the nearest first."""
MULTIPLES = (2, 4, 8)
"""Budgets tried, in multiples of the run's; of a search, or without a sign that more would help, only the first."""
IMPROVING = 0.004
"""A hypothesis is still improving if its last iteration took more than this off the error (share of the diameter)."""


def starved(case: Case) -> Finding | None:
    """A hypothesis that got few iterations comes out right when it gets them all."""
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
        if again.repaired and case.company:
            again = case.rerun_together(f"all on hypothesis {j + 1}", _only_hypothesis(case, j), iterations=each)
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
            )
    return None


def _only_hypothesis(case: Case, j: int) -> Pools:
    """One hypothesis alone, and of each object solved together with it the one that its answer came from."""
    pools: dict[int, Sequence[Hypothesis]] = {}
    for i in case.company:
        pool = case.trace.problem.target(i).instance.hypotheses
        chosen = case.trace.answers[-1][i].arm if i in case.trace.answers[-1] else 0
        pools[i] = pool[chosen : chosen + 1] or pool
    return pools | {case.instance_id: case.target.instance.hypotheses[j : j + 1]}


def budget(case: Case) -> Finding | None:
    """The answer's hypothesis was still getting better at the end, and a larger budget brings it home.

    Of objects solved together it is also asked where one alone would have come out right with its share.
    """
    accepted = _accepted(case)
    falling = accepted[-2] - accepted[-1] if len(accepted) > 1 and accepted[0] <= FAR else 0.0
    still = f"The {case.name} was still getting closer, by {falling:.1%} of the diameter in the last iteration"
    multiples = MULTIPLES
    if falling < IMPROVING:
        if not case.company or not case.rerun(ALONE).repaired:
            return None
        still = f"The search for the {case.name}, whose scene {len(case.company)} objects share, ended too early"
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
            )
    return None


def _with_budget(case: Case, times: int) -> Rerun:
    what = f"{times} × the budget"
    if case.company:
        return case.rerun_together(what, {}, times)
    own = case.lab.method(case.lab.simulator)
    return case.rerun(what, method=case.lab.method(case.lab.simulator, iterations=times * own.iterations))


def no_hypothesis(case: Case) -> Finding:
    """The pool is empty, so that nothing was done."""
    again = _from_truth(case)
    said = f"There is no hypothesis for the {case.name}"
    if np.isfinite(again.error):
        said += f"; started at the truth, it ends {share(again.error)} of the diameter away"
    return Finding(Cause.NO_HYPOTHESIS, f"{said}.", {"hypotheses": 0.0, "error_from_truth": again.error}, True)


def pool(case: Case) -> Finding | None:
    """No hypothesis leads there, and the truth itself as a start does."""
    if outdone(case) is not None:
        return None
    if case.company and case.rerun(ALONE).repaired:
        alone = case.rerun(ALONE)
        return Finding(
            Cause.BUDGET,
            f"The search missed the {case.name}, also with {MULTIPLES[0]} × the budget; with RIR from the same "
            f"hypotheses, among the placed objects, {instead(alone.error, case.error)}.",
            {"times": float(MULTIPLES[0]), "error": case.error, "error_alone": alone.error},
            False,
        )
    again = _from_truth(case)
    j = int(np.argmin(case.initial_errors))
    nearest = float(case.initial_errors[j])
    far = pose_errors(case.target.model, case.target.instance.hypotheses[j].T_cam_obj, case.T_true)
    evidence = {
        "hypotheses": float(len(case.initial_errors)),
        "nearest": float(j),
        "nearest_error": nearest,
        "nearest_rotation_deg": far.rotation_deg,
        "nearest_translation_mm": far.translation_mm,
        "error": case.error,
        "error_from_truth": again.error,
    }
    if again.error >= case.threshold:
        said = f"Even started at the truth, the {case.name} ends {share(again.error)} of the diameter away."
        return Finding(Cause.REFINER, said, evidence, False)
    if nearest < case.threshold:
        said = (
            f"Hypothesis {j + 1} of the {case.name} started {share(nearest)} of the diameter from the truth, and "
            f"refinement lost it: the error is {share(case.error)}."
        )
        return Finding(Cause.REFINER, said, evidence, False)
    T_nearest = case.target.instance.hypotheses[j].T_cam_obj
    way = turning_on(case.target, T_nearest)
    told = f" ({way.in_words(0)})" if way is not None else ""
    unit = of_another_unit(T_nearest, case.T_true, case.target.model.diameter_m)
    wrong = f"; its translation looks like {unit} where millimetres are expected" if unit else ""
    return Finding(
        Cause.POOL,
        f"No hypothesis of the {case.name} leads to the truth: the nearest of {len(case.initial_errors)} (hypothesis "
        f"{j + 1}) starts {far.rotation_deg:.0f}°{told} and {far.translation_mm:.0f} mm away{wrong}; started at the "
        f"truth {instead(again.error, case.error)}.",
        evidence,
        True,
    )


def _from_truth(case: Case) -> Rerun:
    return case.rerun("started at ground truth", case.with_pool(case.T_true))


def _accepted(case: Case) -> list[float]:
    """Errors of what was kept of the answer's hypothesis, iteration by iteration, its start first."""
    if case.answer is None or case.answer.arm >= len(case.initial_errors):
        return []
    kept = [case.error_of(i.accepted_stage.T_cam_obj) for i in case.own if i.arm == case.answer.arm]
    return [float(case.initial_errors[case.answer.arm]), *kept]


SEARCH_TESTS: tuple[Callable[[Case], Finding | None], ...] = (starved, budget, refiner, pool)
