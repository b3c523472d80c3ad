"""A pose moved by hand on the real parts: refined next, and the same bits however the run is repeated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from tests.recording.runs import END
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import Session
from verefine_viz.recording.verify import first_difference, verify
from verefine_viz.run.engine import Run
from verefine_viz.run.run_file import RunFile
from verefine_viz.run.session_file import load_session, resolve, save_session
from verefine_viz.run.toolbox import Toolbox

SESSIONS = Path(__file__).resolve().parents[2] / "sessions"
K = 2


def session_of(name: str) -> Session:
    return resolve(
        {
            "scene": {"demo": "stack"},
            "hypotheses": {"max_per_object": 2},
            "method": {"name": name, "iterations": 2},
            "mcts": {"expansions": 3},
            "recording": {"maps": False},
        }
    )


def near_truth(problem: Problem, i: int) -> Float:
    """4 mm and 9° off."""
    truth = problem.instances[i].T_cam_obj_gt
    return truth @ transform(axis_angle([0, 1, 0], 0.15), [0.004, 0, 0])


def stepped(box: Toolbox, n: int) -> Run:
    run = box.run(box.problem(box.frames[0]))
    for _ in range(n):
        run.step()
    return run


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize("name", ["rir", "vf_depth", "physim_mcts"])
def test_stepped_headless_rewound_saved_and_recorded_are_the_same(name: str, tmp_path: Path) -> None:
    session = session_of(name)
    run = stepped(Toolbox(session), K)
    at = run.iterations[K - 1].instance_id
    i = [x.instance_id for x in run.problem.instances].index(at)
    fork = run.fork(K, edit=(at, 0, near_truth(run.problem, i)))
    if name == "vf_depth":  # Its turn comes once the pass has gone round.
        while fork.step().instance_id != at:
            pass
    else:
        fork.step()
    first = fork.iterations[-1]
    assert (first.instance_id, first.arm) == (at, 0)
    assert np.array_equal(first.stages[0].T_cam_obj, near_truth(run.problem, i))
    while not fork.at_end:
        fork.step()
    again = fork.fork(K + 1)
    again.finish()
    assert first_difference(fork.iterations, again.iterations) is None

    kept = structs.replace(session, edits=fork.edits)
    save_session(kept, tmp_path / "kept.toml")
    box = Toolbox(load_session(tmp_path / "kept.toml"))
    problem = box.problem(box.frames[0])
    file = RunFile(tmp_path / "run.vfrun", box.session)
    loaded = box.run(problem, (file,))
    loaded.finish()
    file.finish(END)
    assert first_difference(fork.iterations, loaded.iterations) is None
    found = verify(file.path)
    assert (found.difference, found.ends_early, found.n_compared) == (None, False, fork.length)


@pytest.mark.usefixtures("processes")
def test_in_the_mug_scene_a_pose_put_near_the_truth_wins() -> None:
    arm = 4
    run = stepped(Toolbox(load_session(SESSIONS / "mug.toml")), K)
    fork = run.fork(K, edit=(run.problem.instances[0].instance_id, arm, near_truth(run.problem, 0)))
    fork.finish()
    assert [i.arm for i in fork.iterations[K : K + 3]] == [arm] * 3
    best = fork.final_state.best[0]
    assert best.arm == arm
    assert best.score.score > 0.9
