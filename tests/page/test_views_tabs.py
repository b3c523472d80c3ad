"""The views behind the tabs: what they send to the browser is what the engine works out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fakes import FakeRefiner
from tests.page.conftest import SESSION
from tests.page.fake_tools import FakeTools
from tests.page.recorded import Numbered, record
from tests.received import received
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.progress_token import NEVER_CANCELLED
from verefine_viz.core.refiner_steps import RefinerStep
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.protocol import Standing, pose_matrix
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.branch_list import branches_message
from verefine_viz.page.views.grasp import grasp
from verefine_viz.page.wants import ANSWERS
from verefine_viz.page.wire import pose_numbers
from verefine_viz.page.workspace import Checks, Workspace
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.proximity import overlap
from verefine_viz.run.compare import aligned, departures, outcomes


def asked(debugger: Debugger, want: p.Wanted) -> dict[str, Any]:
    """Return a view's answer as a browser gets it."""
    answer = received(ANSWERS[type(want)](debugger.space, want, debugger.blobs))
    kind = want.part if isinstance(want, p.LandscapeWanted) else type(want).__struct_config__.tag
    assert answer["what"] == kind, "the browser knows an answer's keys by what it asked for"
    return answer


@pytest.fixture
def opened() -> Callable[..., Debugger]:
    """Open frames of boxes with real checks of physics."""

    def make(*verbs: p.AnyVerb, frame: str = "0/1") -> Debugger:
        space = Workspace(SESSION, None, FakeTools, Checks(plausibility, overlap), frame=frame)
        return Debugger(space, blobs=Blobs()).carry_out(verbs)

    return make


def test_two_runs_compare_as_the_engine_says(opened: Callable[..., Debugger]):
    d = opened(p.RunVerb(), p.Compare(changes={"method.name": "sir"}), frame="0/2")
    a, b = (d.space.branch(k) for k in (0, 1))
    answer = asked(d, p.ComparisonWanted(0, 1))
    pairs = aligned(a.run.iterations, b.run.iterations)
    assert answer["pairs"] == [[*pair] for pair in pairs]
    first = departures(a.run, b.run, pairs).deed
    assert first is not None
    assert answer["departures"][0] == {"place": first.place, "kind": first.kind, "text": first.text, "a": first.a,
                                       "b": first.b}  # fmt: skip
    assert first.text in answer["words"]
    for row, o in zip(answer["rows"], outcomes(a.run, b.run, a.final_evaluator.errors), strict=True):
        assert o.a is not None
        assert o.b is not None
        assert o.b.errors is not None
        assert (row["a"]["score"], row["winner"]) == (o.a.best.score.score, o.winner)
        assert row["b"]["err"] == o.b.errors.add_s_mm
    assert answer["names"] == ["rir", "sir"]
    assert len(answer["frame"]) == 2


def test_physics_says_of_every_object_what_the_check_says(opened: Callable[..., Debugger]):
    d = opened(p.Seek(3), frame="0/2")
    branch = d.space.work.first
    problem, iteration = d.space.problem, branch.run.iterations[2]
    obj, T = iteration.instance_id, iteration.accepted_stage.T_cam_obj
    other = next(i.instance_id for i in problem.instances if i.instance_id != obj)
    best = branch.run.best_at(3)[other]
    stands = (Standing(obj, pose_numbers(T)), Standing(other, pose_numbers(best.T_cam_obj), True))
    answer = asked(d, p.PhysicsWanted(obj, k=3, poses=(("accepted", pose_numbers(T)),), stands=stands, path=3))
    assert {o["obj"] for o in answer["objects"]} == {i.instance_id for i in problem.instances}
    after = answer["poses"][-1]
    assert after["name"] == "accepted"
    own = Placed(obj, problem.target(obj).model, T)
    assert problem.observation.support is not None
    known = plausibility(own, [Placed(other, problem.target(other).model, best.T_cam_obj)], problem.observation.support)
    assert after["gap_mm"] == known.gap_mm
    assert after["depth_mm"] == known.penetration_mm
    assert after["stable"] == known.is_stable
    assert len(after["polygon"]) == len(known.polygon_cam)
    assert iteration.path is not None
    assert answer["path"]["n"] == len(iteration.path.Ts_cam_obj)
    assert answer["path"]["moved_mm"][0] == 0


def test_physics_of_an_edited_pose_is_about_that_pose(opened: Callable[..., Debugger]):
    d = opened(p.RunVerb())
    T = np.array(d.space.problem.instances[0].T_cam_obj_gt)
    T[1, 3] -= 0.05  # The camera's y points down.
    stands = (Standing(0, pose_numbers(T)),)
    answer = asked(d, p.PhysicsWanted(0, poses=(("edited", pose_numbers(T)),), stands=stands, alone=True))
    assert [pose["name"] for pose in answer["poses"]][-1] == "edited"
    assert answer["poses"][-1]["gap_mm"] == pytest.approx(50, abs=1)
    assert answer["poses"][-1]["tone"] == "red"


def test_landscape_has_the_scores_of_its_poses(opened: Callable[..., Debugger]):
    d = opened(p.RunVerb())
    run = d.space.work.first.run
    target, T_best = run.problem.targets[0], run.final_state.best[0].T_cam_obj
    verifier = d.space.tools.verifier
    curves = asked(d, p.LandscapeWanted(0, pose_numbers(T_best), k=run.length))["curves"]
    assert len(curves) == 12
    for curve in curves[::5]:
        poses = np.array([pose_matrix(T) for T in curve["poses"]])
        assert verifier.score(target, poses).score == pytest.approx(curve["scores"])
        assert poses[curve["offsets"].index(0.0)] == pytest.approx(T_best, abs=1e-12)
    two = asked(d, p.LandscapeWanted(0, pose_numbers(T_best), k=run.length, part="slice", axes=(0, 1)))
    middle = len(two["scores"]) // 2
    assert pose_matrix(two["poses"][middle][middle]) == pytest.approx(T_best)
    assert two["scores"][middle][middle] == pytest.approx(run.final_state.best[0].score.score)
    assert asked(d, p.LandscapeWanted(0, pose_numbers(T_best), k=run.length, part="other"))["other"] is None


def test_a_refiner_that_is_not_learned_saw_nothing(opened: Callable[..., Debugger]):
    d = opened(p.RunVerb())
    answer = asked(d, p.CropsWanted(3))
    assert answer["steps"] == []
    assert "not learned" in answer["empty"]
    assert not branches_message(d.space).list[0].explains


class Explaining(Numbered):
    """A program whose refiner shows what it saw."""

    def refiner_of(self, index: int) -> ExplainedRefiner:
        return ExplainedRefiner()


class ExplainedRefiner(FakeRefiner):
    def explain(self, target: Target, T_cam_obj: Float) -> list[RefinerStep]:
        return [RefinerStep({"depth": target.observation.depth_m}, shift_m=np.array([1e-3, 0, 0]))]


@pytest.mark.usefixtures("processes")
def test_the_refiner_of_a_recording_shows_what_it_saw(tmp_path: Path):
    path = record(tmp_path / "run.rrd", Session(method=MethodSettings(iterations=1)))
    d = Debugger(Workspace(SESSION, None, Explaining, recording=path))
    branch = d.space.work.first
    answer = asked(d, p.CropsWanted(1, branch.index))
    assert (answer["empty"], len(answer["steps"])) == ("", 1)
    assert branches_message(d.space).list[0].explains


@pytest.mark.usefixtures("processes")
def test_a_grasp_is_cached_for_the_3d_view(opened: Callable[..., Debugger]):
    d = opened(p.RunVerb())
    T = d.space.work.first.run.final_state.best[0].T_cam_obj
    verb = p.Evaluate("1", "grasp", 0, pose_numbers(T))
    answer = received(grasp(d.space, verb, d.blobs, NEVER_CANCELLED))
    problem, settings = d.space.problem, d.space.work.first.settings.grasp
    pair = d.space.grasps.known(problem, settings, 0, T)
    assert pair is not None
    for side, attempt in ((answer["pose"], pair.answer), (answer["truth"], pair.ground_truth)):
        assert side["verdict"] == attempt.verdict
        assert side["free"] == attempt.is_free.sum()
        assert attempt.path is not None
        assert len(side["frames"]) == side["n"] == attempt.path.n_moments
    assert answer["truth"]["rise_mm"][-1] > 100
    assert d.space.grasps.known(problem, settings, 0, np.eye(4)) is None
