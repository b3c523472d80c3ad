"""PHYSIM-MCTS with its real parts on the built-in clutter scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from verefine_viz.core.algorithm_settings import MctsSettings
from verefine_viz.core.problem import DependencyGraph, Placed, Problem
from verefine_viz.core.settings import ScoreSettings, Session
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.methods.physim_mcts import PhysimMcts, make_physim_mcts, mcts_physics, mcts_tricp
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.recording.verify import first_difference
from verefine_viz.refiners.trimmed_icp import TrimmedIcp
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.explained import ExplainedPixels
from verefine_viz.run.engine import Run
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("long_run")

MCTS = MctsSettings(expansions=4)


def method() -> PhysimMcts:
    session, score = Session(), ScoreSettings(renderer="cpu")
    physics = mcts_physics(MCTS, session.physics)
    refiner = TrimmedIcp(mcts_tricp(MCTS, session.tricp))
    renderer = ExplainedPixels(MCTS.explained_m, score)
    return make_physim_mcts(MCTS, BulletSimulator(physics), refiner, CpuVerifier(score), renderer, physics.steps)


@pytest.fixture(scope="module")
def problem() -> Problem:
    hypotheses = {"max_per_object": 3, "rotation_deg": 15, "translation_mm": 15}
    toolbox = Toolbox(resolve({"scene": {"demo": "clutter"}, "hypotheses": hypotheses}))
    whole = toolbox.problem(toolbox.frames[0])
    ids = tuple(i.instance_id for i in whole.instances[:3])
    return replace(whole.only(ids), dependencies=DependencyGraph((), (ids,), (), "given"))


@pytest.fixture(scope="module")
def run(problem: Problem) -> Run:
    run = Run(method(), problem)
    run.finish()
    return run


def test_the_answer_is_better_than_the_hypotheses_and_explains_the_scene_best(run: Run) -> None:
    assert run.length == 12
    for target, best in zip(run.problem.targets, run.final_state.best, strict=True):
        T_gt = target.instance.T_cam_obj_gt
        given = [pose_errors(target.model, h.T_cam_obj, T_gt).relative for h in target.instance.hypotheses[:-1]]
        assert pose_errors(target.model, best.T_cam_obj, T_gt).relative < min(0.1, *given)
    costs = [it.tree.cost_px for it in run.iterations]
    assert run.iterations[-1].tree.incumbent_cost_px == min(costs)


def test_the_recorded_cost_is_that_of_the_recorded_scene(run: Run) -> None:
    renderer = ExplainedPixels(MCTS.explained_m, ScoreSettings())
    for it in run.iterations:
        poses = {p.instance_id: p.T_cam_obj for p in (*it.placed, *it.tree.rollout)}
        poses[it.instance_id] = it.tree.node.T_cam_obj
        scene = [Placed(k, run.problem.target(k).model, T) for k, T in poses.items()]
        assert renderer.unexplained_px(run.problem.observation, scene) == it.tree.cost_px


def test_stepped_with_side_tracks_and_with_fresh_tools_the_bits_are_the_same(run: Run, problem: Problem) -> None:
    fresh = Run(method(), problem)
    while not fresh.at_end:
        fresh.step()
        if fresh.cursor % 4 == 0:
            fork = fresh.fork(
                fresh.cursor // 2,
                edit=(problem.instances[0].instance_id, 0, np.array(problem.instances[0].hypotheses[1].T_cam_obj)),
            )
            fork.step()
    assert first_difference(run.iterations, fresh.iterations) is None
    assert first_difference(run.final_state.best, fresh.final_state.best) is None
