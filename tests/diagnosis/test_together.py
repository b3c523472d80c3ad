"""Methods that solve objects together are diagnosed by running them again, not something simpler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.failing_scenes import broken_scene, named
from tests.made_up_frames import Broken, Thing, Z, broken_by, frame_of, model, moved, near, session_of, standing
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.diagnosis.case import cluster_of, solved_together
from verefine_viz.recording.verify import first_difference
from verefine_viz.scenes.demo_layout import Viewpoint

pytestmark = pytest.mark.usefixtures("long_run")

IDS = (0, 1)


def beside_a_can(
    name: str,
    rng: np.random.Generator,
    cause: Cause,
    initial_poses: Sequence[Float] | None,
    **sections: dict[str, object],
) -> Broken:
    """Something next to a can; the two are one cluster."""
    m, can = model(name), model("can")
    T, T_can = standing(m, rng, 0.01), standing(can, rng, 0.01)
    T[0, 3] -= 0.06
    T_can[0, 3] += 0.06
    poses = [T @ P for P in initial_poses] if initial_poses is not None else near(T, rng, 1, 18, 25)
    things = [Thing(m, T, tuple(poses)), Thing(can, T_can, near(T_can, rng, 1, 5, 5))]
    order: dict[str, object] = {"order": (("#0", "#1"),)}
    session = session_of("vf_depth", 1 if initial_poses is None else 2, dependency=order, **sections)
    return broken_by(cause, frame_of(things, rng), session)


def quarter_turns() -> list[Float]:
    """Four that fit well and are wrong, and a right one."""
    return [moved(np.eye(4), Z, deg, (1, -1, 0)) for deg in (90, -90, 87, 93)] + [moved(np.eye(4), Z, 8, (4, 3, 5))]


def test_the_same_pools_and_budget_give_the_answer_of_the_run() -> None:
    broken = beside_a_can("carton", np.random.default_rng(0), Cause.POOL, quarter_turns())
    assert cluster_of(broken.problem, 0) == IDS
    answers = broken.toolbox.run(broken.problem).finish().best
    for k in IDS:
        again = solved_together(broken.toolbox, broken.problem, k, {})
        assert first_difference(again, answers[k]) is None


def test_a_starved_hypothesis_is_found_by_the_method_itself() -> None:
    settings: dict[str, object] = {"exploration": 0.05}
    broken = beside_a_can("carton", np.random.default_rng(0), Cause.ARM_STARVED, quarter_turns(), method=settings)
    diagnosis = named(broken)
    assert diagnosis is not None
    assert diagnosis.main.cause == Cause.ARM_STARVED
    assert diagnosis.main.is_confirmed


def test_a_budget_that_ends_too_early_is_found_by_the_method_itself() -> None:
    icp: dict[str, object] = {"max_iterations": 4}
    physics: dict[str, object] = {"enabled": False}
    rng = np.random.default_rng(0)
    diagnosis = named(beside_a_can("duck", rng, Cause.BUDGET, None, icp=icp, physics=physics))
    assert diagnosis is not None
    assert diagnosis.main.cause == Cause.BUDGET
    assert diagnosis.main.is_confirmed


def test_a_misplaced_neighbour_is_put_right_in_the_search_for_both() -> None:
    broken = broken_scene(Cause.NEIGHBOUR, 1)
    together = replace(broken, toolbox=broken.toolbox.restarted({"method": {"name": "vf_depth"}}))
    diagnosis = named(together)
    assert diagnosis is not None
    assert diagnosis.main.cause == Cause.NEIGHBOUR
    assert diagnosis.main.is_confirmed


def test_numbers_of_the_scores_of_scenes_say_so() -> None:
    glass, can, rng = broken_scene(Cause.SCORE, 0).problem, model("can"), np.random.default_rng(5)
    T_world_cam = Viewpoint(elevation_deg=40, distance_m=0.52).T_world_cam
    (instance,) = glass.instances
    assert instance.T_cam_obj_gt is not None
    poses = tuple(T_world_cam @ h.T_cam_obj for h in instance.hypotheses)
    T_can = standing(can, rng, 0.0)
    T_can[:2, 3] += [-0.14, 0.0]
    jug = Thing(model("jug"), T_world_cam @ instance.T_cam_obj_gt, poses, seen_as=model("jug without handle"))
    things = [jug, Thing(can, T_can, near(T_can, rng, 1, 5, 5))]
    session = session_of("vf_depth", 3, dependency={"order": (("#0", "#1"),)}, physics={"enabled": False})
    broken = broken_by(Cause.SCORE, frame_of(things, rng), session)
    diagnosis = named(broken)
    assert diagnosis is not None
    assert diagnosis.main.cause == Cause.SCORE
    assert diagnosis.main.text.startswith("The scene's score prefers ")
    assert {name for name in diagnosis.main.numbers if not name.startswith("scene_")} == {"error"}
    run = broken.toolbox.run(broken.problem)
    Ts = np.array([[best.T_cam_obj for best in run.finish().best if best is not None]])
    score = broken.toolbox.verifier.score_scene(broken.problem.targets, Ts)[0]
    assert diagnosis.main.numbers["scene_score"] == score.score
    assert diagnosis.main.numbers["scene_depth_fit"] == score.depth_fit
