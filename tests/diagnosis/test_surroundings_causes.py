"""Causes where the depth image, not a plane alone, says what supports the objects."""

from __future__ import annotations

import numpy as np
import pytest

from tests.made_up_frames import Thing as Made
from tests.made_up_frames import frame_of, leaning, level, model, near, standing
from verefine_viz.core.problem import Target
from verefine_viz.diagnosis.case import Case
from verefine_viz.diagnosis.diagnose import failed_cases
from verefine_viz.diagnosis.input_causes import depth
from verefine_viz.diagnosis.scene_causes import plane
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("long_run")


@pytest.mark.parametrize(
    ("support", "tilt_deg", "is_wrong"),
    [("plane", 0, True), ("observed", 0, False), ("plane", 30, True), ("observed", 30, True)],
)
def test_observed_surroundings_need_of_the_plane_only_which_way_is_up(
    support: str, tilt_deg: float, is_wrong: bool
) -> None:
    """It lies 3 cm too low, and may be tilted."""
    rng = np.random.default_rng(0)
    m = model("carton")
    T = standing(m, rng)
    toolbox = Toolbox(resolve({"method": {"refiner": "icp", "iterations": 1}, "physics": {"support": support}}))
    things = [Made(m, T, near(T, rng, 1, 8, 8))]
    problem = frame_of(things, rng, spoil_support=lambda right: leaning(right, level(0.0), tilt_deg, 0.03))
    run = toolbox.run(toolbox.surrounded(toolbox.ordered(problem)))
    run.finish()
    (case,) = failed_cases(run, toolbox, 0.0)
    assert (plane(case) is not None) == is_wrong


def test_a_depth_image_put_right_has_surroundings_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    m = model("duck")
    T = standing(m, rng)
    toolbox = Toolbox(resolve({"method": {"refiner": "icp", "iterations": 1}, "physics": {"support": "observed"}}))
    things = [Made(m, T, near(T, rng, 1, 8, 8))]
    problem = frame_of(things, rng, spoil_depth=lambda depth_m, _masks: np.roll(depth_m, 25, axis=1))
    run = toolbox.run(toolbox.surrounded(toolbox.ordered(problem)))
    run.finish()
    (case,) = failed_cases(run, toolbox, 0.0)
    asked: list[Target] = []

    def rerun(_case: Case, _what: str, target: Target) -> None:
        asked.append(target)
        raise NotImplementedError

    monkeypatch.setattr(Case, "rerun", rerun)
    with pytest.raises(NotImplementedError):
        depth(case)
    support = asked[0].observation.support
    assert support is not None
    assert support.surroundings is not None
