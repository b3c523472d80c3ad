"""The contract of every method on the real parts: stepped ≡ headless ≡ rewound ≡ by other workers, bit for bit.

Everything of an iteration is compared but times: poses, scores, contacts, the bandit's numbers, events, the tree.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from tests.recording.runs import ending
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.presets import PRESETS
from verefine_viz.core.problem import Problem
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES
from verefine_viz.recording import entities
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.recording.verify import first_difference, verify
from verefine_viz.run.engine import Run
from verefine_viz.run.run_file import RunFile
from verefine_viz.run.session_file import load_session, resolve, save_session
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("long_run")

SESSIONS = Path(__file__).resolve().parents[2] / "sessions"
K = 2
"""Iterations before a pose is moved by hand."""

LIKE_OTHERS = ("refine", "phys_before", "phys_after", "even", "expl", "pir")
"""Methods of which other presets change the refiner, physics and the score alone, as they do of all others."""
IN_SURROUNDINGS = ("pir", "rir", "vf_breadth", "vf_depth")
"""Methods whose contract is checked among observed surroundings as well."""
Runs = dict[tuple[str, str], Future[tuple[Iteration, ...]]]
"""The run of a method with a preset, once a worker has made it."""
CASES = [
    *product(ALL_METHOD_NAMES, ["recommended"]),
    *((name, preset) for preset in ("paper", "published") for name in ALL_METHOD_NAMES if name not in LIKE_OTHERS),
    *product(IN_SURROUNDINGS, ["observed"]),
]


def session_of(name: str, preset: str = "recommended") -> dict[str, object]:
    """``preset`` may also be "observed": the recommended settings among observed surroundings."""
    return {
        "preset": "recommended" if preset == "observed" else preset,
        "physics": {"support": "observed"} if preset == "observed" else {},
        "scene": {"demo": "clutter"},
        "hypotheses": {"max_per_object": 3},
        "method": {"name": name, "iterations": 2},
        "mcts": {"expansions": 4},
    }


def _world(preset: str) -> str:
    return "observed" if preset == "observed" else "recommended"


@cache
def two_objects(preset: str) -> Problem:
    """Made once per process: it is the same for all methods, and takes longer than most runs."""
    box = Toolbox(resolve(session_of("rir", preset)))
    whole = box.problem(box.frames[0])
    return whole.only([i.instance_id for i in whole.instances[:2]])


def headless_run(name: str, preset: str) -> tuple[Iteration, ...]:
    run = Toolbox(resolve(session_of(name, preset))).run(two_objects(_world(preset)))
    run.finish()
    return run.iterations


@pytest.fixture(scope="module")
def by_workers(processes: None) -> Iterator[Runs]:
    """Every case, shared out between two processes: each does other runs before than the other."""
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        yield {case: pool.submit(headless_run, *case) for case in CASES}


@pytest.mark.parametrize(("name", "preset"), CASES)
def test_stepping_headless_rewinding_and_any_number_of_workers_are_the_same(
    name: str, preset: str, by_workers: Runs
) -> None:
    box = Toolbox(resolve(session_of(name, preset)))
    headless = box.run(two_objects(_world(preset)))
    headless.finish()
    stepped: Run = box.run(two_objects(_world(preset)))  # the same tools, with another history behind them
    while not stepped.at_end:
        stepped.step()
        fork = stepped.fork(stepped.cursor // 2)  # side tracks must leave no trace
        if not fork.at_end:
            fork.step()
    assert first_difference(headless.iterations, stepped.iterations) is None
    assert first_difference(headless.iterations, headless_run(name, preset)) is None
    assert first_difference(headless.iterations, by_workers[name, preset].result()) is None


def test_every_kind_of_record_is_among_them(by_workers: Runs) -> None:
    """Else the comparison would pass over what it means to compare."""
    for preset in PRESETS:
        rir, deep, tree = (by_workers[name, preset].result() for name in ("rir", "vf_depth", "physim_mcts"))
        assert all(it.choice is not None for it in rir)
        assert any(len(c.depths_m) for it in rir if it.path for c in it.path.contacts)
        assert any(it.events for it in rir)
        assert any(it.scene for it in deep)
        assert any(it.placed for it in deep)
        assert all(it.tree for it in tree)


def test_scoring_pixels_do_not_change_the_poses_of_pir() -> None:
    """PIR looks at no score, so its poses may not depend on how the score counts."""
    poses = []
    for pixels in ("classes", "published"):
        box = Toolbox(resolve({**session_of("pir"), "score": {"pixels": pixels}}))
        run = box.run(two_objects("recommended"))
        run.finish()
        poses.append([it.accepted_stage.T_cam_obj for it in run.iterations])
    assert np.array_equal(poses[0], poses[1])


def upside_down(flips: bool, weight: float = 0.1) -> Toolbox:
    """A pack whose ends differ in colour alone, of which every hypothesis is upside down."""
    raw = {"demo": "failure_score_prefers_flip"}, {"max_per_object": 2, "flips": flips}
    method, score = {"name": "rir", "iterations": 3}, {"colour_weight": weight}
    return Toolbox(resolve({"scene": raw[0], "hypotheses": raw[1], "method": method, "score": score}))


def test_with_flips_stepping_headless_and_rewinding_are_the_same(tmp_path: Path) -> None:
    box = upside_down(flips=True)
    problem = box.problem(box.frames[0])
    file = RunFile(tmp_path / "run.vfrun", box.session)
    headless = box.run(problem, (file,))
    headless.finish()
    file.finish(ending(headless))
    assert any(it.accepted == "flipped" for it in headless.iterations)
    stepped = box.run(problem)
    while not stepped.at_end:
        stepped.step()
        fork = stepped.fork(stepped.cursor // 2)
        if not fork.at_end:
            fork.step()
    assert first_difference(headless.iterations, stepped.iterations) is None
    again = verify(file.path)
    assert again.difference is None
    assert again.n_compared == headless.length


def test_flips_bring_the_pack_the_right_way_up_by_colour_and_by_nothing_else() -> None:
    errors = {}
    for flips, weight in product((False, True), (0.0, 0.1)):
        box = upside_down(flips, weight)
        (target,) = box.problem(box.frames[0]).targets
        (best,) = box.run(box.problem(box.frames[0])).finish().best
        errors[flips, weight] = pose_errors(target.model, best.T_cam_obj, target.instance.T_cam_obj_gt).relative
    assert errors[True, 0.1] < 0.05
    assert min(errors[True, 0.0], errors[False, 0.0], errors[False, 0.1]) > 0.3


def test_with_a_learned_refiner_stepping_headless_and_replaying_are_the_same(tmp_path: Path) -> None:
    """What it saw is drawn into the recording and changes nothing."""
    raw = session_of("rir")
    raw["method"] = {"name": "rir", "iterations": 2, "refiner": "depth_net_icp"}
    box, problem = Toolbox(resolve(raw)), two_objects("recommended")
    headless = box.run(problem)
    headless.finish()
    stepped = Toolbox(resolve(raw)).run(problem)
    while not stepped.at_end:
        stepped.step()
    assert first_difference(headless.iterations, stepped.iterations) is None
    recorder = Recorder(tmp_path / "run.rrd", box.session, problem, box.verifier_of, refiner_of=box.refiner_of)
    file = RunFile(tmp_path / "run.vfrun", box.session)
    recorded = box.run(problem, [recorder, file])
    recorded.finish()
    file.finish(ending(recorded))
    recorder.close(file.path.read_bytes())
    assert first_difference(headless.iterations, recorded.iterations) is None
    drawn = [chunk for chunk in chunks_of(tmp_path / "run.rrd") if chunk.entity_path == entities.REFINER]
    assert sum(chunk.num_rows for chunk in drawn) == len(headless.iterations)
    again = verify(tmp_path / "run.rrd")
    assert again.difference is None


# A pose moved by hand on the real parts: refined next, and the same bits however the run is repeated.


def edited_session(name: str) -> Session:
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
    session = edited_session(name)
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
    file.finish(ending(loaded))
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
