"""The two studies of parts of the method.

Ablation: what each part is worth, over the error of the initial pose (Sec. V-A, Fig. 4). Robustness: how much depth may
be missing (Sec. V-B, Fig. 5).
"""

from __future__ import annotations

from verefine_viz.core.problem import Problem
from verefine_viz.studies.disturbance import disturbed, occluded, without_top
from verefine_viz.studies.study_plan import Claim, Curve, Panel, Prepare, Study

ITERATIONS = 5
"""K, refiner calls per hypothesis."""
HYPOTHESES = 5
STEP, LARGEST = 5, 30
"""Errors from 0 to the largest [°, mm]."""
SINGLE = (("refiner alone", "refine"), ("PhysBefore", "phys_before"), ("PhysAfter", "phys_after"))
SINGLE += (("PIR", "pir"), ("SIR", "sir"))
SEVERAL = (("EVEN", "even"), ("EXPL", "expl"), ("RIR", "rir"))
ROTATION_DEG, TRANSLATION_MM = 5.0, 5.0
"""Error of the initial poses where depth is missing."""
ROBUSTNESS_TREND = "the refiner alone loses most as depth goes; what physics adds (SIR, RIR) lasts longest"


def ablation(quick: bool = False) -> Study:
    """Four diagrams: rotation or translation error, one hypothesis or five.

    ``quick``: three errors instead of seven.
    """
    xs = tuple(float(x) for x in range(0, LARGEST + 1, 3 * STEP if quick else STEP))
    one = tuple(Curve(label, {"method": {"name": name, "iterations": ITERATIONS}}) for label, name in SINGLE)
    # SIR has one hypothesis only; it gets the refiner calls that the others share among five.
    sir = Curve("SIR, first hypothesis", {"method": {"name": "sir", "iterations": ITERATIONS * HYPOTHESES}})
    five = tuple(Curve(label, {"method": {"name": name, "iterations": ITERATIONS}}) for label, name in SEVERAL)
    panels = []
    for error, unit in (("rotation", "°"), ("translation", "mm")):
        label = f"{error} error of the initial pose [{unit}]"
        physics = (Claim("PIR", "PhysBefore"), Claim("PIR", "PhysAfter")) if error == "rotation" else ()
        panels.append(
            Panel(
                f"{error}, one hypothesis",
                label,
                xs,
                one,
                _initial_poses(error, 1),
                (*physics, Claim("SIR", "PIR"), Claim("SIR", "refiner alone")),
                "physics between the refiner's calls beats physics before or after them; supervision (SIR) beats both",
            )
        )
        panels.append(
            Panel(
                f"{error}, five hypotheses",
                label,
                xs,
                (*five, sir),
                _initial_poses(error, HYPOTHESES),
                (Claim("RIR", "EVEN"), Claim("RIR", "EXPL"), Claim("RIR", "SIR, first hypothesis")),
                "choosing by the bandit (RIR) beats an even share and all on the best first score",
            )
        )
    return Study("ablation", "Ablation: error of the initial poses (paper, Fig. 4)", tuple(panels))


def _initial_poses(error: str, n: int) -> Prepare:
    def prepare(problem: Problem, x: float, seed: int) -> Problem:
        rotation_deg, translation_mm = (x, 0.0) if error == "rotation" else (0.0, x)
        return disturbed(problem, n, rotation_deg, translation_mm, seed)

    return prepare


def robustness(quick: bool = False) -> Study:
    """Two diagrams: depth lost behind rectangles, or above a height.

    ``quick``: four shares instead of ten.
    """
    xs = tuple(x / 100 for x in range(0, 91, 30 if quick else 10))
    curves = tuple(
        Curve(label, {"method": {"name": name, "iterations": ITERATIONS}})
        for label, name in (*SINGLE, *SEVERAL)
        if name not in ("even", "expl")
    )
    claims = (Claim("SIR", "refiner alone"), Claim("RIR", "refiner alone"), Claim("RIR", "SIR"))
    label = "share of the object's depth that is missing"
    panels = (
        Panel("occlusion", label, xs, curves, _rectangles_lost, claims, ROBUSTNESS_TREND),
        Panel("material", label, xs, curves, _top_lost, claims, ROBUSTNESS_TREND),
    )
    return Study("robustness", "Robustness: missing depth (paper, Fig. 5)", panels)


def _rectangles_lost(problem: Problem, x: float, seed: int) -> Problem:
    return occluded(disturbed(problem, HYPOTHESES, ROTATION_DEG, TRANSLATION_MM, seed), x, seed)


def _top_lost(problem: Problem, x: float, seed: int) -> Problem:
    return without_top(disturbed(problem, HYPOTHESES, ROTATION_DEG, TRANSLATION_MM, seed), x)
