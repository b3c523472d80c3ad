"""Does a better pose lift more objects? The paper's Table IV (Sec. V-D) with a simulated gripper, and the curve of
success over the error of the pose.

Trials differ in their initial poses (a seed each) where the paper puts the objects down again; for half of them the
objects are turned (``scene.turned``).
"""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.core.problem import Problem
from verefine_viz.studies.budgets import budget_of
from verefine_viz.studies.disturbance import disturbed, first_poses, with_ground_truth
from verefine_viz.studies.paper_tables import MCTS, POOL, ROTATION_DEG, TRANSLATION_MM
from verefine_viz.studies.study_plan import Claim, Panel, Prepare, Study, StudyCurve

TABLE = "table"
"""The panel of Table IV; the others are curves over the error."""
GIVEN = "pose with this error"
ERRORS_MM = (0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
ERRORS_DEG = (0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0)
HYPOTHESES, SHORT, LONG = 5, 2, 10
"""H, and #ref/obj of Table IV: refiner calls per object."""
ORDER = (
    ("+ RIR, 10", "+ SIR, 2"),
    ("+ RIR, 10", "alone, 10"),
    ("+ RIR, 10", f"{MCTS}, 10"),
    (f"{MCTS}, 10", "+ SIR, 2"),
    ("+ SIR, 2", "alone, 2"),
)
"""Which row of Table IV lifts more than which, by the ends of their names."""


def grasping(quick: bool = False, own_initial_poses: bool = False, refiner: str = "icp") -> Study:
    """Table IV, and two curves.

    Args:
        quick: fewer errors, and without the methods that the paper's table does not have.
        own_initial_poses: the session's own initial poses instead of disturbed ground truth.
        refiner: the session's.
    """
    name = budget_of(refiner).name
    rows = [("alone", "refine", SHORT, 1), ("+ SIR", "sir", SHORT, 1)]
    rows += [("alone", "refine", LONG, 1), ("+ RIR", "rir", LONG, HYPOTHESES)]
    if not quick:
        rows += [("+ VF_b", "vf_breadth", LONG, HYPOTHESES), ("+ VF_d", "vf_depth", LONG, HYPOTHESES)]
    # The table counts refiner calls per object: those with several hypotheses share them out.
    curves = [
        StudyCurve(
            f"{name} {suffix}, {calls}", {"method": {"name": method, "refiner": refiner, "iterations": calls // arms}}
        )
        for suffix, method, calls, arms in rows
    ]
    mcts = {"method": {"name": "physim_mcts", "refiner": refiner}, "mcts": {"expansions": LONG, "seconds": None}}
    curves.insert(3, StudyCurve(f"{MCTS}, {LONG}", mcts, most_calls=LONG))
    claims = tuple(Claim(_ending(curves, better), _ending(curves, worse)) for better, worse in ORDER)
    prepare = _unchanged if own_initial_poses else _far
    given = (StudyCurve(GIVEN, None),)
    every = 2 if quick else 1
    return Study(
        "grasping",
        "Grasping, as in Table IV",
        (
            Panel(TABLE, "", (0.0,), tuple(curves), prepare, claims, is_grasped=True),
            Panel("translation", "error of the pose [mm]", ERRORS_MM[::every], given, _off(0.0, 1.0), is_grasped=True),
            Panel("rotation", "error of the pose [°]", ERRORS_DEG[::every], given, _off(1.0, 0.0), is_grasped=True),
        ),
        own=(*POOL, "mcts.trim"),
    )


def _ending(curves: Sequence[StudyCurve], end: str) -> str:
    return next(curve.label for curve in curves if curve.label.endswith(end))


def _unchanged(problem: Problem, x: float, seed: int) -> Problem:
    return first_poses(with_ground_truth(problem), HYPOTHESES)


def _far(problem: Problem, x: float, seed: int) -> Problem:
    return disturbed(problem, HYPOTHESES, ROTATION_DEG, TRANSLATION_MM, seed)


def _off(deg: float, mm: float) -> Prepare:
    def prepare(problem: Problem, x: float, seed: int) -> Problem:
        return disturbed(problem, 1, deg * x, mm * x, seed)

    return prepare
