"""Recordings exported from the page, made by the real parts: run again, they give the same, bit by bit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.progress import Countdown
from verefine_viz.core.errors import Cancelled
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, PhysicsSettings, SceneSettings, Session
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.verify import verify
from verefine_viz.run.record import session_of
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes import demo
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.export import Exporter

pytestmark = pytest.mark.usefixtures("processes")

SESSION = Session(
    title="box",
    scene=SceneSettings(demo="failure_simulation_topples"),
    hypotheses=HypothesesSettings(max_per_object=2),
    method=MethodSettings(iterations=2),
)


@pytest.fixture(scope="module", autouse=True)
def drawn_once() -> Iterator[None]:
    """Draws each built-in scene once for all tests: that is the longest part of opening it."""
    draw, known = demo.demo_problem, dict[str, Problem]()

    def remembered(*given: Any) -> Problem:
        key = " ".join(map(str, given[:4]))
        if key not in known:
            known[key] = draw(*given)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "demo_problem", remembered)
        yield


class NoServer:
    """Recordings need no page."""


@pytest.fixture
def debugger(tmp_path: Path) -> Debugger:
    server: Any = NoServer()
    return Debugger(SESSION, None, Toolbox, write=Exporter(server, tmp_path))


def exported(debugger: Debugger) -> Path:
    debugger.carry_out([c.Export("recording")])
    path = debugger.written[0].path
    assert debugger.message == f"Written: {path}"
    assert path.is_absolute()
    recorded = read_recording(path)
    assert recorded.is_complete
    assert len(recorded.iterations) == debugger.workspace.run.length
    return path


def moved(debugger: Debugger, shift_m: float) -> list[c.Command]:
    debugger.carry_out([c.EditPose()])
    T_cam_obj = np.array(debugger.options.T_cam_obj_edited)
    T_cam_obj[0, 3] += shift_m
    return [c.DragPose(tuple(float(x) for x in T_cam_obj.ravel())), c.ForkFromPose()]


def test_one_that_is_cancelled_is_not_there_and_the_next_is_whole(tmp_path: Path) -> None:
    server: Any = NoServer()
    countdown = Countdown()
    debugger = Debugger(SESSION, None, Toolbox, write=Exporter(server, tmp_path, countdown.progress))
    debugger.carry_out([c.RunTo(3)])
    for k in range(4):  # Before it is begun, and before each iteration.
        countdown.left = k
        with pytest.raises(Cancelled):
            debugger.apply(c.Export("recording"))
        assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
        assert debugger.written == ()
    countdown.left = None
    assert verify(exported(debugger)).difference is None


def test_of_a_run_and_of_its_beginning(debugger: Debugger) -> None:
    debugger.carry_out([c.RunTo(2)])
    assert verify(exported(debugger)).difference is None
    debugger.carry_out([c.RunUntil("end")])
    assert verify(exported(debugger)).difference is None


def test_of_a_fork_with_a_moved_pose_and_other_settings(debugger: Debugger) -> None:
    debugger.carry_out([c.RunTo(2), c.Seek(1)])
    debugger.carry_out([*moved(debugger, 0.004), c.RunTo(3)])
    changes = (("method.exploration", 0.4), ("physics.steps", 6), ("icp.max_iterations", 4))
    debugger.carry_out([c.Fork(changes, run=True)])
    path = exported(debugger)
    session = session_of(read_recording(path).header)
    assert len(session.edits) == 1
    assert session.changes[0].after_iteration == 3
    assert verify(path).difference is None


@pytest.mark.parametrize("changes", [(("method.name", "sir"),), (("physics.enabled", False), ("score.tau_m", 0.03))])
def test_of_a_fork_before_the_first_iteration(debugger: Debugger, changes: c.Changes) -> None:
    debugger.carry_out([c.RunUntil("end"), c.Fork(changes, 0, run=True), c.Seek(1)])
    debugger.carry_out([*moved(debugger, 0.003), c.RunUntil("end")])
    assert verify(exported(debugger)).difference is None


def test_of_a_fork_from_before_a_change_keeps_the_change(debugger: Debugger) -> None:
    debugger.carry_out([c.RunTo(3), c.Fork((("physics.steps", 7),), 2, run=True), c.Fork((), 1, run=True)])
    path = exported(debugger)
    session = session_of(read_recording(path).header)
    assert [(k.after_iteration, k.settings) for k in session.changes] == [(1, {"physics": {"steps": 7}})]
    assert verify(path).difference is None


def test_of_forks_of_a_session_that_changes_on_the_way(debugger: Debugger, tmp_path: Path) -> None:
    debugger.carry_out([c.RunTo(2), c.Fork((("method.exploration", 5.0),), run=True)])
    server: Any = NoServer()
    for commands in ([c.RunTo(3), c.Fork((("physics.steps", 6),))], [c.RunTo(1), c.Fork()]):
        again = Debugger(debugger.workspace.session, None, Toolbox, write=Exporter(server, tmp_path))
        again.carry_out([*commands, c.RunUntil("end")])
        assert again.view().session.method.exploration == 5.0
        assert verify(exported(again)).difference is None


def test_of_b_after_it_became_the_open_run(debugger: Debugger) -> None:
    debugger.carry_out([c.RunUntil("end"), c.CompareRun((("method.name", "sir"),)), c.SwapSides()])
    path = exported(debugger)
    assert session_of(read_recording(path).header).method.name == "sir"
    assert verify(path).difference is None


def test_of_other_initial_poses(tmp_path: Path) -> None:
    server: Any = NoServer()
    mug = {"scene": SceneSettings(demo="mug"), "physics": PhysicsSettings(enabled=False)}
    debugger = Debugger(SESSION.model_copy(update=mug), None, Toolbox, write=Exporter(server, tmp_path))
    before = debugger.workspace.work.problem.instances[0].hypotheses[0].T_cam_obj
    debugger.carry_out([c.Restart((("hypotheses.seed", 5), ("method.iterations", 1))), c.RunUntil("end")])
    assert not np.array_equal(debugger.workspace.work.problem.instances[0].hypotheses[0].T_cam_obj, before)
    assert verify(exported(debugger)).difference is None
