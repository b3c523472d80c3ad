"""The two studies of parts of the method.

Ablation: what each part is worth, over the error of the initial pose (Sec. V-A, Fig. 4). Robustness: how much depth may
be missing (Sec. V-B, Fig. 5).
"""

from __future__ import annotations

from verefine_viz.core.problem import Problem
from verefine_viz.studies.budgets import Budget, budget_of
from verefine_viz.studies.disturbance import disturbed, occluded, on_true_plane, without_top
from verefine_viz.studies.study_plan import Claim, Panel, Prepare, Study, StudyCurve

HYPOTHESES = 5
"""Hypotheses of Fig. 4, bottom."""
STEP, LARGEST = 5, 30
"""Errors from 0 to the largest [°, mm]."""
LOW, HIGH = 10.0, 20.0
"""Errors up to the first are low, from the second on high [°, mm]."""
SIMULATING = (("PhysBefore", "phys_before"), ("PhysAfter", "phys_after"), ("PIR", "pir"), ("SIR", "sir"))
SEVERAL = (("EVEN", "even"), ("EXPL", "expl"), ("RIR", "rir"))
ROTATION_DEG, TRANSLATION_MM = 5.0, 5.0
"""Error of the initial poses where depth is missing."""
LIMITED = "PIR is limited under translation: it keeps only the rotation that physics finds"
SUPERVISED = "supervision gains most under translation error"
POSES = ("hypotheses", "scene.gravity", "physics.support", "physics.mesh", "physics.dropped")
"""What the ablation makes itself: initial poses, and the support plane."""


def ablation(quick: bool = False, refiner: str = "densefusion") -> Study:
    """Four diagrams: rotation or translation error, one hypothesis or five.

    Args:
        quick: three errors instead of seven.
        refiner: of all curves, with the paper's budget.
    """
    budget, about = budget_of(refiner), budget_of(refiner).about
    xs = tuple(float(x) for x in range(0, LARGEST + 1, 3 * STEP if quick else STEP))
    alone = budget.name
    five = tuple(budget.curve(label, name) for label, name in SEVERAL)
    # SIR has one hypothesis only; it gets the refiner calls that the others share among five.
    sir = budget.curve("SIR, first hypothesis", "sir", budget.calls * HYPOTHESES)
    several = (
        Claim("RIR", "EVEN"),
        Claim("RIR", "EXPL"),
        Claim("RIR", sir.label),
        Claim("EVEN", "EXPL", to_x=LOW, reading="EVEN performs well for low error"),
        Claim("EXPL", "EVEN", from_x=HIGH, reading="EXPL is robust to high error"),
    )
    of_error = {
        "rotation": (
            Claim("PIR", "PhysBefore"),
            Claim("PIR", "PhysAfter"),
            Claim(alone, "PhysAfter", reading="PhysAfter is worse than the refiner alone"),
        ),
        "translation": (
            Claim("PhysBefore", "PIR", reading=LIMITED),
            Claim("PhysAfter", "PIR", reading=LIMITED),
            Claim("SIR", "PIR", reading=SUPERVISED, than=_single_panel("rotation")),
            Claim("SIR", alone, reading=SUPERVISED, than=_single_panel("rotation")),
        ),
    }
    top: list[Panel] = []
    bottom: list[Panel] = []
    for error, unit in (("rotation", "°"), ("translation", "mm")):
        label = f"{error} error [{unit}]"
        one = (*of_error[error], Claim("SIR", "PIR"), Claim("SIR", alone))
        name = f"{error}, {HYPOTHESES} hypotheses"
        top.append(Panel(_single_panel(error), label, xs, _single(budget), _initial_poses(error, 1), one, about))
        bottom.append(Panel(name, label, xs, (*five, sir), _initial_poses(error, HYPOTHESES), several, about))
    return Study("ablation", "Ablation (Fig. 4)", (*top, *bottom), POSES)


def _single_panel(error: str) -> str:
    """Name of the panel with one hypothesis."""
    return f"{error}, 1 hypothesis"


def _single(budget: Budget) -> tuple[StudyCurve, ...]:
    """The refiner alone, and every way to add physics."""
    alone = budget.alone(budget.name, budget.short)
    return alone, *(budget.curve(label, name) for label, name in SIMULATING)


def _initial_poses(error: str, n: int) -> Prepare:
    def prepare(problem: Problem, x: float, seed: int) -> Problem:
        rotation_deg, translation_mm = (x, 0.0) if error == "rotation" else (0.0, x)
        return disturbed(on_true_plane(problem), n, rotation_deg, translation_mm, seed)

    return prepare


def robustness(quick: bool = False, refiner: str = "densefusion") -> Study:
    """Two diagrams: depth lost behind rectangles, or above a height.

    Args:
        quick: four shares instead of ten.
        refiner: of all curves, with the paper's budget.
    """
    budget = budget_of(refiner)
    xs = tuple(x / 100 for x in range(0, 91, 30 if quick else 10))
    # As many calls as each of the others, one for each hypothesis.
    rir = budget.curve(f"RIR, {budget.calls} hypotheses", "rir", 1)
    curves = (*_single(budget), rir)
    claims = (Claim("SIR", budget.name), Claim(rir.label, budget.name))
    label = "missing share of depth"

    def prepared(problem: Problem, seed: int) -> Problem:
        return disturbed(problem, budget.calls, ROTATION_DEG, TRANSLATION_MM, seed)

    panels = (
        Panel(
            "occlusion",
            label,
            xs,
            curves,
            lambda p, x, seed: occluded(prepared(p, seed), x, seed),
            claims,
            budget.about,
        ),
        Panel(
            "material", label, xs, curves, lambda p, x, seed: without_top(prepared(p, seed), x), claims, budget.about
        ),
    )
    return Study("robustness", "Robustness (Fig. 5)", panels, ("hypotheses",))
