"""Simulators of other programs: they say where an object goes, and all else goes on as with Bullet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import verefine_viz as vv
from tests.fakes import box_problem
from tests.physics.bodies import placed, ring, table
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, PartError, SettingsError, ShapeError
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.settings import PhysicsSettings, ScoreSettings, Session
from verefine_viz.estimators.registry import ESTIMATORS, make_estimator
from verefine_viz.page.protocol import Fork, RunVerb
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace
from verefine_viz.physics.registry import SIMULATORS, make_simulator
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.recording.verify import first_difference
from verefine_viz.refiners.registry import REFINERS, make_refiner
from verefine_viz.rendering.registry import VERIFIERS, make_verifier
from verefine_viz.run.session_file import resolve
from verefine_viz.run.session_parts import check_names
from verefine_viz.run.toolbox import Toolbox

OWN = PhysicsSettings(simulator="own")


class Rises:
    """Lifts an object by a millimetre a step."""

    def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> Float:
        path = np.tile(moving.T_cam_obj, (n_steps + 1, 1, 1))
        path[:, :3, 3] += 1e-3 * np.arange(n_steps + 1)[:, None] * support.T_world_cam[2, :3]
        return path


class WrappedBullet:
    """Bullet, as if it were another program's."""

    def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> Float:
        return BulletSimulator(PhysicsSettings(collider="hull")).settle(moving, fixed, support, n_steps).Ts_cam_obj


@pytest.fixture(autouse=True)
def own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SIMULATORS, "own", lambda settings: Rises())


def session(**physics: Any) -> Session:
    return resolve(
        {
            "scene": {"demo": "duck"},
            "method": {"name": "sir", "refiner": "icp", "iterations": 2},
            "hypotheses": {"max_per_object": 2},
            "physics": {"collider": "hull"} | physics,
        }
    )


def poses_of(one: Session) -> list[bytes]:
    tools = Toolbox(one)
    run = tools.run(tools.problem(tools.frames[0]))
    run.finish()
    return [stage.T_cam_obj.tobytes() for i in run.iterations for stage in i.stages]


def test_a_path_of_it_is_poses_without_contacts():
    simulator = make_simulator(OWN)
    assert simulator is not None
    start = placed(ring(), (0, 0, 0.1))
    path = simulator.settle(start, (), table(), 4)
    assert [len(contacts.points_cam) for contacts in path.contacts] == [0] * 4
    assert path.tipping is None
    up = table().T_world_cam @ path.Ts_cam_obj
    np.testing.assert_allclose(np.diff(up[:, 2, 3]), 1e-3)
    assert np.array_equal(path.Ts_cam_obj[0], start.T_cam_obj)


@pytest.mark.usefixtures("processes")
def test_bullet_through_it_gives_the_run_of_bullet(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(SIMULATORS, "own", lambda settings: WrappedBullet())
    ours, theirs = poses_of(session()), poses_of(session(simulator="own"))
    assert ours == theirs
    assert len(ours) >= 6


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (np.eye(4), r"poses of shape \(4, 4\) for 3 steps, expected 4×4×4"),
        (np.full((4, 4, 4), np.nan), "pose 0 of simulator own holds NaN"),
        (np.tile(2 * np.eye(4), (4, 1, 1)), "pose 0 of simulator own"),
        (np.tile(np.eye(4), (4, 1, 1)), "path of simulator own does not begin at the given pose"),
    ],
)
def test_what_is_no_path_is_refused(given: Float, words: str, monkeypatch: pytest.MonkeyPatch):
    class Wrong:
        def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> Float:
            return given

    monkeypatch.setitem(SIMULATORS, "own", lambda settings: Wrong())
    simulator = make_simulator(OWN)
    assert simulator is not None
    with pytest.raises(ShapeError, match=words):
        simulator.settle(placed(ring(), (0, 0, 0.1)), (), table(), 3)


@pytest.mark.usefixtures("processes")
def test_the_page_forks_from_bullet_to_it():
    space = Workspace(session(), None, Toolbox)
    debugger = Debugger(space).carry_out([RunVerb(0), Fork(1, changes={"physics.simulator": "own"}, run=True)])
    first, fork = (branch.run.iterations for branch in debugger.space.work.branches.values())
    assert first_difference(first[0], fork[0]) is None
    path = fork[1].path
    assert path is not None
    assert len(path.contacts[-1].points_cam) == 0
    assert fork[1].stages[1].T_cam_obj[1, 3] != first[1].stages[1].T_cam_obj[1, 3]


@pytest.mark.usefixtures("processes")
def test_a_name_that_is_not_there_lists_those_that_are():
    with pytest.raises(
        SettingsError, match=r"unknown simulator 'bulet'; did you mean 'bullet'\? available: bullet, own"
    ):
        make_simulator(PhysicsSettings(simulator="bulet"))
    with pytest.raises(SettingsError, match="unknown simulator 'mujoco'"):
        check_names(session(simulator="mujoco"))
    with pytest.raises(
        SettingsError, match=r"unknown hypotheses.source 'pff'; did you mean 'ppf'\? available: results"
    ):
        check_names(resolve({"hypotheses": {"source": "pff"}}))


def test_a_path_ends_where_the_object_leaves_the_reach_of_the_camera(monkeypatch: pytest.MonkeyPatch):
    class Throws:
        def settle(self, moving: Placed, fixed: Sequence[Placed], support: Support, n_steps: int) -> Float:
            path = np.tile(moving.T_cam_obj, (n_steps + 1, 1, 1))
            path[2:, 2, 3] += 1e4
            return path

    monkeypatch.setitem(SIMULATORS, "own", lambda settings: Throws())
    simulator = make_simulator(OWN)
    assert simulator is not None
    path = simulator.settle(placed(ring(), (0, 0, 0.1)), (), table(), 5)
    assert (len(path.Ts_cam_obj), len(path.contacts)) == (2, 1)


def test_what_a_part_raises_names_it_and_the_line(monkeypatch: pytest.MonkeyPatch):
    class Broken:
        def settle(self, *_: Any) -> Any:
            raise ValueError("no such body")

        refine = hypotheses = scores = settle

    (target,) = box_problem().targets
    T = target.instance.hypotheses[0].T_cam_obj
    for registry in (REFINERS, ESTIMATORS, VERIFIERS):
        monkeypatch.setitem(registry, "broken", None)
    for register in (vv.refiner, vv.estimator, vv.verifier, vv.simulator):
        register("broken")(Broken)
    calls = {
        "refiner": lambda: make_refiner("broken", Session()).refine(target, T),
        "estimator": lambda: make_estimator("broken", Session()).hypotheses(target, 3),
        "verifier": lambda: make_verifier(ScoreSettings(verifier="broken")).score(target, T[None]),
        "simulator": lambda: make_simulator(PhysicsSettings(simulator="broken")).settle(  # type: ignore[union-attr]
            placed(ring(), (0, 0, 0.1)), (), table(), 3
        ),
    }
    for kind, call in calls.items():
        words = rf"^{kind} broken raised ValueError: no such body \(test_own_simulator.py, line \d+\)$"
        with pytest.raises(PartError, match=words):
            call()


def test_a_part_may_write_into_what_it_is_given_and_the_next_call_sees_what_was_observed(
    monkeypatch: pytest.MonkeyPatch,
):
    seen: list[tuple[bytes, bytes, bytes]] = []

    class Writes:
        def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
            arrays = (target.instance.points_cam, target.observation.depth_m, target.model.points)
            seen.append(tuple(array.tobytes() for array in arrays))  # type: ignore[arg-type]
            for array in (*arrays, T_cam_obj):
                array[...] = 0
            assert not target.instance.points_cam.any()  # Within a call it stays written.
            T_cam_obj[...] = np.eye(4)
            same.append(target.model)
            return T_cam_obj

    same: list[object] = []
    (target,) = box_problem(n_hypotheses=1).targets
    monkeypatch.setitem(REFINERS, "writes", None)
    vv.refiner("writes")(Writes)
    refiner, T = make_refiner("writes", Session()), target.instance.hypotheses[0].T_cam_obj
    before = target.model.points.copy()
    for _ in range(2):
        refiner.refine(target, T)
    assert seen[0] == seen[1]
    assert seen[0][2] == target.model.points.tobytes() == before.tobytes()
    assert same[0] is same[1]  # What a part caches by a model is found again.
    assert isinstance(same[0], type(target.model))


def test_answers_of_refiners_and_estimators_are_checked(monkeypatch: pytest.MonkeyPatch):
    class Wrong:
        def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
            return T_cam_obj[:3]

        def hypotheses(self, target: Target, n: int, progress: object = None) -> list[Any]:
            return [np.eye(4)] if n == 1 else [*target.instance.hypotheses] * 9

    (target,) = box_problem(n_hypotheses=2).targets
    for registry in (REFINERS, ESTIMATORS):
        monkeypatch.setitem(registry, "wrong", None)
    vv.refiner("wrong")(Wrong)
    vv.estimator("wrong")(Wrong)
    with pytest.raises(ShapeError, match=r"pose of refiner wrong has shape \(3, 4\)"):
        make_refiner("wrong", Session()).refine(target, np.eye(4))
    estimator = make_estimator("wrong", Session())
    with pytest.raises(ShapeError, match="estimator wrong gave ndarray, expected Hypothesis"):
        estimator.hypotheses(target, 1)
    assert len(estimator.hypotheses(target, 5)) == 5


def test_names_of_the_package_are_taken():
    with pytest.raises(InputError, match="name of the simulator of this package"):
        vv.simulator("bullet")(Rises)
    with pytest.raises(InputError, match="has no method settle"):
        vv.simulator("box")(type(box_problem()))  # type: ignore[type-var]
    for name in ("perturb", "session"):
        with pytest.raises(InputError, match="another source of initial poses"):
            vv.estimator(name)(Rises)  # type: ignore[type-var]
