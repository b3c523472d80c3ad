"""Answers that are nowhere near: far off, out of the picture, behind the camera, never rendered. Each has a cause."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.changing import replace
from tests.made_up_frames import Thing, frame_of, model, standing
from verefine_viz.batch.solve_frame import with_causes
from verefine_viz.batch.summary import run_end
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.problem import Hypothesis, Placed, Problem, Target
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("long_run")

LOST: dict[str, tuple[float, float, float]] = {
    "two diameters to the side": (0.25, 0.0, 0.0),
    "out of the picture": (3.0, 0.0, 0.0),
    "far behind": (0.0, 0.0, 20.0),
    "just before the camera": (0.0, 0.0, -0.5),
    "behind the camera": (0.0, 0.0, -2.0),
    "below the table": (0.0, 1.0, 0.0),
}
"""Shifts of the ground truth, in the camera's frame [m]."""
METHODS: tuple[dict[str, Any], ...] = (
    {"name": "refine", "refiner": "identity"},
    {"name": "rir", "refiner": "icp", "iterations": 2},
    {"name": "vf_depth", "refiner": "icp", "iterations": 1},
)


class Throws:
    """A refiner that takes every pose to one place."""

    def __init__(self, T_cam_obj: Float) -> None:
        self._T_cam_obj = T_cam_obj

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        return self._T_cam_obj


def starting_at(problem: Problem, T_cam_obj: Float) -> Problem:
    (instance,) = problem.instances
    return replace(problem, instances=(replace(instance, hypotheses=(Hypothesis(T_cam_obj, 1.0, "start"),)),))


@pytest.mark.parametrize("where", LOST)
def test_a_lost_object_has_a_cause(where: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    m = model("duck")
    scene = frame_of([Thing(m, standing(m, rng), ())], rng)
    T_gt = scene.instances[0].T_cam_obj_gt
    assert T_gt is not None
    T = T_gt.copy()
    T[:3, 3] += LOST[where]
    lost, thrown = starting_at(scene, T), starting_at(scene, T_gt)
    cases = [(method, lost, None) for method in METHODS] + [
        (METHODS[0], thrown, Throws(T)),
        (METHODS[0], lost, Throws(T)),
    ]
    for method, problem, refiner in cases:
        toolbox = Toolbox(resolve({"method": method}), refiner=refiner)
        run = toolbox.run(toolbox.ordered(problem))
        run.finish()
        for every_cause in (False, True):
            (diagnosis,) = diagnose(run, toolbox, every_cause=every_cause)
            assert diagnosis.main.cause in set(Cause), method
        (answer,) = with_causes(run_end(run, toolbox.session), run, toolbox, tmp_path).answers
        assert answer.cause == diagnosis.main.cause, method
        assert answer.is_correct is False, method
        assert not re.search(r"no diagnosis|Error\b|Exception", answer.evidence), (method, answer.evidence)
