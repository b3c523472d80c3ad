"""The contract of every method on the real parts: stepped ≡ headless ≡ rewound ≡ in another process, bit for bit."""

from __future__ import annotations

import hashlib
import multiprocessing

import numpy as np
import pytest

from verefine_viz.core.compare import first_difference
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Iteration
from verefine_viz.methods.registry import ALL_METHOD_NAMES
from verefine_viz.session.engine import Run
from verefine_viz.session.files import resolve
from verefine_viz.session.toolbox import Toolbox


def session_of(name: str, preset: str = "recommended") -> dict[str, object]:
    return {
        "preset": preset,
        "scene": {"demo": "clutter"},
        "hypotheses": {"max_per_object": 3},
        "method": {"name": name, "iterations": 2},
        "mcts": {"expansions": 4},
    }


@pytest.fixture(scope="module")
def toolbox() -> Toolbox:
    return Toolbox(resolve(session_of("rir")))


@pytest.fixture(scope="module")
def problem(toolbox: Toolbox) -> Problem:
    whole = toolbox.problem(toolbox.frames[0])
    return whole.only([i.instance_id for i in whole.instances[:2]])


def digest(iterations: tuple[Iteration, ...]) -> str:
    """A hash of all poses and scores, for comparison across processes."""
    h = hashlib.sha256()
    for it in iterations:
        for stage in it.stages:
            h.update(stage.T_cam_obj.tobytes())
            h.update(np.float64(stage.score.score if stage.score else -1).tobytes())
        h.update(it.accepted.encode())
        if it.path is not None:
            h.update(it.path.Ts_cam_obj.tobytes())
    return h.hexdigest()


def digest_in_a_fresh_process(name: str) -> str:
    box = Toolbox(resolve(session_of(name)))
    whole = box.problem(box.frames[0])
    run = box.run(whole.only([i.instance_id for i in whole.instances[:2]]))
    run.finish()
    return digest(run.iterations)


@pytest.mark.parametrize("preset", ["recommended", "published"])
@pytest.mark.parametrize("name", ALL_METHOD_NAMES)
def test_stepping_headless_and_rewinding_are_the_same(
    name: str, preset: str, toolbox: Toolbox, problem: Problem
) -> None:
    box = Toolbox(resolve(session_of(name, preset)))
    headless = box.run(problem)
    headless.finish()
    stepped: Run = box.run(problem)  # the same tools, with another history behind them
    while not stepped.at_end:
        stepped.step()
        fork = stepped.fork(stepped.cursor // 2)  # side tracks must leave no trace
        if not fork.at_end:
            fork.step()
    assert first_difference(headless.iterations, stepped.iterations) is None
    fresh = Toolbox(resolve(session_of(name, preset))).run(problem)
    fresh.finish()
    assert first_difference(headless.iterations, fresh.iterations) is None


def test_another_process_gives_the_same_bits(toolbox: Toolbox) -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        theirs = pool.map(digest_in_a_fresh_process, ["rir", "vf_depth", "physim_mcts"])
    ours = [digest_in_a_fresh_process(name) for name in ("rir", "vf_depth", "physim_mcts")]
    assert theirs == ours


def test_scoring_pixels_do_not_change_the_poses_of_pir(problem: Problem) -> None:
    """PIR looks at no score, so its poses may not depend on how the score counts."""
    poses = []
    for pixels in ("classes", "published"):
        box = Toolbox(resolve({**session_of("pir"), "score": {"pixels": pixels}}))
        run = box.run(problem)
        run.finish()
        poses.append([it.accepted_stage.T_cam_obj for it in run.iterations])
    assert np.array_equal(*map(np.array, poses))
