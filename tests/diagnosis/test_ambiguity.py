"""Poses that the observation cannot tell apart, and those that it can."""

from __future__ import annotations

import numpy as np
import pytest

from tests.failing_scenes import broken_scene, hidden_handle
from tests.made_up_frames import Thing, broken_by, frame_of, model, moved, near, session_of, standing
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.geometry import inverse
from verefine_viz.diagnosis.case import Case
from verefine_viz.diagnosis.diagnose import diagnose, failed_cases
from verefine_viz.diagnosis.score_causes import ambiguous
from verefine_viz.evaluation.allowed_search import run_poses
from verefine_viz.scenes.demo_layout import Viewpoint

pytestmark = pytest.mark.usefixtures("long_run")


def case_of(name: str, poses: tuple[Float, ...], T: Float, view: Viewpoint) -> Case:
    """The failure of the first of the initial poses T_world_obj, which nothing refines."""
    session = session_of("sir", 1, method={"refiner": "identity"}, physics={"enabled": False}, score={"tau_m": 0.01})
    broken = broken_by(Cause.POOL, frame_of([Thing(model(name), T, poses)], np.random.default_rng(0), view), session)
    run = broken.toolbox.run(broken.problem)
    run.finish()
    (case,) = failed_cases(run, broken.toolbox)
    return case


def test_a_correct_pose_on_a_slope_that_scores_as_much_by_chance_is_not_ambiguous() -> None:
    """Ground truth next to it scores far more, which is what the observation can tell."""
    m, view = model("carton"), Viewpoint(elevation_deg=40, distance_m=0.52)
    T = standing(m, np.random.default_rng(1), yaw_deg=90)
    right, _down, away = m.diameter_m * view.T_world_cam[:3, :3].T

    def shifted(way: Float, share: float) -> Float:
        return moved(T, np.array([0, 0, 1.0]), 0.0, 1e3 * share * way)

    wrong = shifted(right, 0.11)
    first = case_of("carton", (wrong,), T, view)

    def score(T_world_obj: Float) -> float:
        T_cam_obj = inverse(view.T_world_cam) @ T_world_obj
        return first.lab.verifier.score(first.target, T_cam_obj[None])[0].score

    low, high = 0.0, 0.095
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if score(shifted(away, middle)) > score(wrong) else (low, middle)
    on_slope = shifted(away, low)
    assert score(on_slope) == pytest.approx(score(wrong), abs=2e-4)
    assert score(T) > score(wrong) + 0.05
    case = case_of("carton", (wrong, on_slope), T, view)
    assert case.initial_errors[1] < case.threshold <= case.error
    assert ambiguous(case) is None


@pytest.mark.parametrize("method", ["vf_depth", "physim_mcts"])
def test_a_hidden_handle_is_ambiguous_whatever_solved_the_scene(method: str) -> None:
    rng = np.random.default_rng(2)
    jug, can = hidden_handle(rng).problem, model("can")
    T_world_cam = Viewpoint(elevation_deg=18, distance_m=0.52).T_world_cam
    (instance,) = jug.instances
    assert instance.T_cam_obj_gt is not None
    poses = tuple(T_world_cam @ h.T_cam_obj for h in instance.hypotheses)
    T_can = standing(can, rng, 0.0)
    T_can[:2, 3] += [0.13, 0.02]
    things = [
        Thing(model("jug"), T_world_cam @ instance.T_cam_obj_gt, poses),
        Thing(can, T_can, near(T_can, rng, 1, 5, 5)),
    ]
    session = session_of(
        method, 2, physics={"enabled": False}, dependency={"order": (("#0", "#1"),)},
        mcts={"expansions": 3, "physics": "session"},
    )  # fmt: skip
    broken = broken_by(Cause.AMBIGUOUS, frame_of(things, rng, Viewpoint(elevation_deg=18, distance_m=0.52)), session)
    run = broken.toolbox.run(broken.problem)
    run.finish()
    (diagnosis,) = diagnose(run, broken.toolbox)
    assert (diagnosis.instance_id, diagnosis.main.cause) == (0, Cause.AMBIGUOUS), diagnosis.main.text
    assert diagnosis.main.numbers["apart_mm"] > 0.1 * 1e3 * model("jug").diameter_m
    assert abs(diagnosis.main.numbers["score"] - diagnosis.main.numbers["score_of_other"]) < 0.001


def test_the_poses_of_a_run_are_also_those_that_completed_a_scene() -> None:
    broken = broken_scene(Cause.NEIGHBOUR, 1)
    toolbox = broken.toolbox.restarted({"method": {"name": "physim_mcts"}, "mcts": {"expansions": 2}})
    run = toolbox.run(broken.problem)
    run.finish()
    for target in run.problem.targets:
        own = target.instance.instance_id
        poses = {T.tobytes() for T in run_poses(target, run.iterations)}
        assert poses >= {h.T_cam_obj.tobytes() for h in target.instance.hypotheses}
        for iteration in run.iterations:
            assert iteration.tree is not None
            for placed in (*iteration.placed, *iteration.tree.rollout, *iteration.tree.incumbent):
                assert placed.instance_id != own or placed.T_cam_obj.tobytes() in poses
