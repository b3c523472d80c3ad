"""How much depth may be missing. Source: Sec. V-B, Fig. 5."""

from __future__ import annotations

from verefine_viz.core.problem import Problem
from verefine_viz.studies.ablation import HYPOTHESES, ITERATIONS, SEVERAL, SINGLE
from verefine_viz.studies.disturb import disturbed, occluded, without_top
from verefine_viz.studies.study import Claim, Curve, Panel, Prepare, Study

ROTATION_DEG, TRANSLATION_MM = 5.0, 5.0
"""Error of the first poses."""
TREND = "the refiner alone loses most as depth goes; what physics adds (SIR, RIR) lasts longest"


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
        Panel("occlusion", label, xs, curves, _with_loss(by_height=False), claims, TREND),
        Panel("material", label, xs, curves, _with_loss(by_height=True), claims, TREND),
    )
    return Study("robustness", "Robustness: missing depth (paper, Fig. 5)", panels)


def _with_loss(by_height: bool) -> Prepare:
    def prepare(problem: Problem, x: float, seed: int) -> Problem:
        first = disturbed(problem, HYPOTHESES, ROTATION_DEG, TRANSLATION_MM, seed)
        return without_top(first, x) if by_height else occluded(first, x, seed)

    return prepare
