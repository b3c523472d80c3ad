"""Answers without ground truth that cannot lie where they are."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from tests.made_up_frames import Thing, frame_of, model, moved, session_of, standing
from verefine_viz.batch.summary import run_end
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.diagnosis.impossible import impossible_answers
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.proximity import Surfaces
from verefine_viz.run.toolbox import Toolbox

CARTON, CAN = model("carton"), model("can")
PHYSICAL = partial(plausibility, settings=PhysicsSettings(collider="hull"), surface_of=Surfaces())


def blind(problem: Problem) -> Problem:
    """The frame without ground truth."""
    return replace(problem, instances=tuple(replace(i, T_cam_obj_gt=None) for i in problem.instances))


@pytest.fixture(scope="module")
def two() -> tuple[Problem, list[Float]]:
    """A carton and a can on a table, and their true poses T_cam_obj."""
    rng = np.random.default_rng(0)
    things = [
        Thing(m, moved(standing(m, rng, 0.0), np.array([0, 0, 1.0]), 0, (x, 0, 0)))
        for m, x in ((CARTON, -80), (CAN, 80))
    ]
    problem = frame_of(things, rng)
    return problem, [i.T_cam_obj_gt for i in problem.instances if i.T_cam_obj_gt is not None]


def raised(problem: Problem, T_cam_obj: Float, mm: float) -> Float:
    """Further away from the support plane."""
    support = problem.observation.support
    assert support is not None
    T = T_cam_obj.copy()
    T[:3, 3] += 1e-3 * mm * (support.T_world_cam[:3, :3].T @ support.normal_world)
    return T


def test_what_sinks_or_floats_is_impossible_with_its_millimetres(two: tuple[Problem, list[Float]]) -> None:
    problem, (carton, can) = two
    unknown = blind(problem)
    assert impossible_answers(unknown, [carton, can], PHYSICAL, None) == {}
    assert impossible_answers(unknown, [None, None], PHYSICAL, None) == {}
    found = impossible_answers(unknown, [raised(problem, carton, -20), raised(problem, can, 30)], PHYSICAL, None)
    sunk, floating = found[0], found[1]
    assert {sunk.cause, floating.cause} == {Cause.IMPOSSIBLE}
    assert sunk.numbers["penetration_mm"] == pytest.approx(20, abs=2)
    assert floating.numbers["gap_mm"] == pytest.approx(30, abs=2)
    assert sunk.text.startswith("The carton cannot lie where its answer has it. Sinks ")
    assert floating.detail.startswith(": floats ")
    shifted = can.copy()
    shifted[:3, 3] = carton[:3, 3]
    assert "into the can." in impossible_answers(unknown, [carton, shifted], PHYSICAL, None)[0].text
    assert impossible_answers(problem, [raised(problem, carton, -20), can], PHYSICAL, None) == {}, (
        "ground truth says more"
    )


def test_a_plane_in_doubt_accuses_no_pose(two: tuple[Problem, list[Float]]) -> None:
    problem, (carton, can) = two
    support = problem.observation.support
    assert support is not None
    doubted = replace(problem.observation, support=replace(support, inlier_share=0.2))
    unknown = blind(replace(problem, observation=doubted))
    assert impossible_answers(unknown, [raised(problem, carton, -20), can], PHYSICAL, None) == {}
    none = blind(replace(problem, observation=replace(problem.observation, support=None)))
    assert impossible_answers(none, [raised(problem, carton, -20), can], PHYSICAL, None) == {}


@pytest.mark.parametrize("name", ["rir", "refine"])
def test_a_batch_says_so_where_the_method_simulates(name: str) -> None:
    rng = np.random.default_rng(0)
    T = moved(standing(CARTON, rng), np.array([0, 0, 1.0]), 0, (0, 0, 60))
    session = session_of(name, 1, method={"refiner": "identity"}, physics={"collider": "hull"})
    toolbox = Toolbox(session)
    problem = toolbox.ordered(blind(frame_of([Thing(CARTON, T, (T,))], rng)))
    run = toolbox.run(problem)
    run.finish()
    (row,) = run_end(run, session).answers
    assert row.cause == (Cause.IMPOSSIBLE if name == "rir" else "")
    assert ("Floats: 59.9 mm" in row.evidence) == (name == "rir")
