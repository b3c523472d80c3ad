"""What each part of the method is worth, over the error of the first pose. Source: Sec. V-A, Fig. 4."""

from __future__ import annotations

from verefine_viz.core.problem import Problem
from verefine_viz.studies.disturb import disturbed
from verefine_viz.studies.study import Claim, Curve, Panel, Prepare, Study

ITERATIONS = 5
"""K, refiner calls per hypothesis."""
HYPOTHESES = 5
STEP, LARGEST = 5, 30
"""Errors from 0 to the largest [°, mm]."""
SINGLE = (("refiner alone", "refine"), ("PhysBefore", "phys_before"), ("PhysAfter", "phys_after"))
SINGLE += (("PIR", "pir"), ("SIR", "sir"))
SEVERAL = (("EVEN", "even"), ("EXPL", "expl"), ("RIR", "rir"))


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
        label = f"{error} error of the first pose [{unit}]"
        physics = (Claim("PIR", "PhysBefore"), Claim("PIR", "PhysAfter")) if error == "rotation" else ()
        panels.append(
            Panel(
                f"{error}, one hypothesis",
                label,
                xs,
                one,
                _first_poses(error, 1),
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
                _first_poses(error, HYPOTHESES),
                (Claim("RIR", "EVEN"), Claim("RIR", "EXPL"), Claim("RIR", "SIR, first hypothesis")),
                "choosing by the bandit (RIR) beats an even share and all on the best first score",
            )
        )
    return Study("ablation", "Ablation: error of the first poses (paper, Fig. 4)", tuple(panels))


def _first_poses(error: str, n: int) -> Prepare:
    def prepare(problem: Problem, x: float, seed: int) -> Problem:
        rotation_deg, translation_mm = (x, 0.0) if error == "rotation" else (0.0, x)
        return disturbed(problem, n, rotation_deg, translation_mm, seed)

    return prepare
