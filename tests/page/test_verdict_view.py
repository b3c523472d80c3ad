"""The verdict on a run: whether its answers are right, and why not."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier
from tests.made_runs import answer
from tests.page.fake_tools import FakeTools
from tests.received import received
from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause, cause_title
from verefine_viz.core.doubt import Doubt, DoubtKind
from verefine_viz.core.finding import Finding
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import (
    ANSWER,
    DependencyGraph,
    Edge,
    EdgeState,
    Instance,
    Placed,
    Problem,
    RecordedStep,
    Target,
)
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.diagnosis.lost_poses import Discarded
from verefine_viz.diagnosis.signs import FinishedObject
from verefine_viz.methods.registry import make_method
from verefine_viz.page import protocol as p
from verefine_viz.page.branch import Branch
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views import verdict as view
from verefine_viz.page.views.physics_doubts import RAISED_M, doubts_of, height_above_plane_m
from verefine_viz.page.workspace import Workspace

TRUE: dict[bytes, Float] = {}
"""By the points of an instance, where it is: the fakes go by that, and the frames below lack it or have it wrong."""


@pytest.fixture(autouse=True)
def trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The ground truth of some frames below is wrong on purpose."""
    monkeypatch.setattr("verefine_viz.calibration.consistency.data_doubts", lambda problem: ())
    monkeypatch.setattr("verefine_viz.diagnosis.data_doubts.doubts", lambda problem: ())


def at_truth(target: Target) -> Target:
    T_gt = TRUE[target.instance.points_cam.tobytes()]
    return replace(target, instance=replace(target.instance, T_cam_obj_gt=T_gt))


class Seeing(FakeVerifier):
    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        return super().score(at_truth(target), Ts_cam_obj, placed)


class SeeingRefiner(FakeRefiner):
    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        return super().refine(at_truth(target), T_cam_obj, fixed)


class Blind(FakeTools):
    """Frames without ground truth."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.verifier = Seeing()

    @property
    def method(self) -> Any:
        return make_method(self.session.method, FakeSimulator(), SeeingRefiner(), self.verifier, 3)

    def problem(self, frame: str, **_: object) -> Problem:
        problem = super().problem(frame)
        for instance in problem.instances:
            assert instance.T_cam_obj_gt is not None
            TRUE[instance.points_cam.tobytes()] = instance.T_cam_obj_gt
        return replace(problem, instances=tuple(self.known(i) for i in problem.instances))

    def known(self, instance: Instance) -> Instance:
        return replace(instance, T_cam_obj_gt=None)


class Astray(Blind):
    """Frames whose ground truth is 100 mm beside the pose that scores best."""

    def known(self, instance: Instance) -> Instance:
        assert instance.T_cam_obj_gt is not None
        return replace(instance, T_cam_obj_gt=transform(np.eye(3), [0.1, 0, 0]) @ instance.T_cam_obj_gt)


def run(tools: type[FakeTools] = FakeTools, name: str = "rir", frame: str = "0/1") -> Branch:
    """Return a branch that came to its end."""
    session = Session(method=MethodSettings(name=name, iterations=4))
    return Debugger(Workspace(session, None, tools, frame=frame)).carry_out([p.RunVerb()]).space.work.first


def judged(branch: Branch, o: FinishedObject, by_batch: Any = None) -> dict[str, Any]:
    return received(view._object(branch, o, by_batch))


def off(mm: float, relative: float) -> PoseErrors:
    return PoseErrors(10.0, mm, mm, mm, mm, relative)


def test_right_wrong_and_unknown():
    for tools, tone in ((FakeTools, "right"), (Astray, "wrong"), (Blind, "unknown")):
        branch = run(tools)
        (shown,) = received(view.verdict_message(branch))["objects"]
        best = branch.run.final_state.best[0]
        assert shown["tone"] == tone
        assert shown["T"] == best.T_cam_obj.ravel().tolist()
        assert (shown["err"] is None) == (tools is Blind)
        assert (shown["k"], shown["arm"], shown["score"]) == (best.iteration, best.arm, best.score.score)
    unfinished = Debugger(Workspace(Session(), None, FakeTools)).carry_out([p.Step()]).space.work.first
    assert view.verdict_message(unfinished).objects == []


def test_of_several_objects_the_worst_is_named():
    right, wrong = (received(view.verdict_message(run(tools, frame="0/2"))) for tools in (FakeTools, Astray))
    assert (right["scene"]["tone"], right["scene"]["words"]) == ("right", "2 of 2 right")
    assert (wrong["scene"]["tone"], wrong["scene"]["words"]) == ("wrong", "0 of 2 right")
    errors = {o["obj"]: o["err"] / o["limit"] for o in wrong["objects"]}
    assert wrong["scene"]["worst"] == max(errors, key=lambda own: errors[own])


def test_a_recorded_pose_that_was_no_answer_is_not_blamed_on_the_search():
    branch = run(Astray)
    (own,) = view.finished_objects(branch)
    branch.settings = Session(method=MethodSettings(name="trace", refiner="identity"))
    for names, is_unanswered in ((("refined", "refined"), True), (("refined", ANSWER), False), ((), False)):
        steps = tuple(RecordedStep(0, np.eye(4), name) for name in names)
        target = replace(own.target, instance=replace(own.target.instance, recorded=steps))
        shown = judged(branch, replace(own, target=target))
        assert shown["tone"] == "wrong"
        assert (shown["words"] == view.UNANSWERED) == is_unanswered


def test_without_ground_truth_the_least_certain_axis_is_named():
    branch = run(Blind)
    (own,) = view.finished_objects(branch)
    other: Any = SimpleNamespace(apart_mm=31.2, score=0.8, score_of_answer=0.81, noise=0.01, T_cam_obj=np.eye(4))
    for width, words in (
        (25.0, "turn about the vertical undetermined within ±25°"),
        (0.3, "a pose 31 mm away fits as well"),
    ):
        axis = SimpleNamespace(kind="turn")
        widest = SimpleNamespace(describe=lambda words=words: words, width=width, axis=axis)
        allowed: Any = SimpleNamespace(
            least_certain=widest, furthest=other, radius_mm=80.0, extents=(), alike=(), score=0.8
        )
        shown = judged(branch, replace(own, allowed=allowed))
        assert (shown["tone"], shown["words"]) == ("doubt", words)
        assert shown["also_fits"] == np.eye(4).ravel().tolist()


def test_a_correct_pose_that_was_given_up_is_named_with_its_margin():
    branch = run(Astray)
    (own,) = view.finished_objects(branch)
    assert own.answer is not None
    lower = replace(own.answer.score, score=own.answer.score.score - 0.003)
    given_up = Discarded(1, 2, branch.run.iterations[1].accepted_stage, lower, 3, own.answer)
    shown = judged(branch, replace(own, discarded=given_up, errors=off(15.7, 0.13), score_at_gt=None))
    assert shown["words"] == "correct at iteration 2, given up for a score 0.003 higher"
    first = shown["findings"][0]
    assert (first["k"], "was correct at iteration 2" in first["text"]) == (3, True)


def test_data_in_doubt_come_before_every_cause(monkeypatch: pytest.MonkeyPatch):
    branch = run(Astray)
    (own,) = view.finished_objects(branch)
    of_another, of_all = (Doubt(DoubtKind.CAMERA, "cam_K does not fit", short="K", instances=own) for own in ((7,), ()))
    monkeypatch.setattr(Branch, "doubts", lambda self: (of_another,))
    assert judged(branch, own)["words"] != "look at the data first: K"
    monkeypatch.setattr(Branch, "doubts", lambda self: (of_all,))
    assert judged(branch, own)["words"] == "look at the data first: K"


# Objects that stand on others, where every object is settled on the support plane alone.


def stacked(state: EdgeState = "used") -> type[FakeTools]:
    class Stacked(FakeTools):
        def problem(self, frame: str, **_: object) -> Problem:
            edge = Edge("support", 0, 1, 0.9, "64% of its footprint", state)
            return replace(super().problem(frame), dependencies=DependencyGraph((edge,), ((0, 1),), (), "recommended"))

    return Stacked


def raised(by_m: float) -> type[FakeTools]:
    """Ground truth of the second box has its lowest point so high above the plane; there is no dependency graph."""

    class Raised(FakeTools):
        def problem(self, frame: str, **_: object) -> Problem:
            problem = super().problem(frame)
            support, target = problem.observation.support, problem.targets[-1]
            truth, height_m = target.instance.T_cam_obj_gt, height_above_plane_m(target)
            assert height_m is not None
            assert support is not None
            assert truth is not None
            lifted = truth.copy()
            lifted[:3, 3] += (by_m - height_m) * support.T_world_cam[:3, :3].T @ support.normal_world
            instances = (*problem.instances[:-1], replace(problem.instances[-1], T_cam_obj_gt=lifted))
            return replace(problem, instances=instances, dependencies=None)

    return Raised


def stacking_words(tools: type[FakeTools], name: str = "rir", physics: bool = True) -> str:
    session = Session(method=MethodSettings(name=name, iterations=1), physics=PhysicsSettings(enabled=physics))
    branch = Workspace(session, None, tools, frame="0/2").work.first
    return " ".join(d for d in doubts_of(branch, branch.run.problem.observation.support) if "settles" in d)


def test_what_stands_on_another_object_is_warned_of():
    assert "box #1 stands on box #0, so it sinks" in stacking_words(stacked())
    for by_m in (RAISED_M + 0.005, 0.08):
        assert f"box #1 stands {by_m * 1e3:.0f} mm above the table" in stacking_words(raised(by_m))
    assert stacking_words(raised(RAISED_M - 0.001)) == ""


def test_methods_that_know_of_it_or_do_not_simulate_say_nothing():
    for name in ("vf_breadth", "vf_depth", "refine"):
        assert stacking_words(stacked(), name) == "", name
    assert stacking_words(stacked(), physics=False) == ""
    assert stacking_words(stacked("cut")) == ""
    assert stacking_words(FakeTools) == ""


def test_the_batch_s_cause_stands_first_and_is_not_repeated():
    branch = run(Astray)
    (own,) = view.finished_objects(branch)
    alone = judged(branch, own)
    known = alone["findings"][0]["cause"]
    more = len(alone["findings"]) + 1
    for cause, n in ((Cause.BUDGET, more), ("of_another_version", more), (known, more - 1)):
        row = answer(findings=(Finding(cause, "by re-runs", iteration=1),), worst_iteration=2)
        shown = judged(branch, own, row)
        assert len(shown["findings"]) == n
        assert shown["words"] == cause_title(cause)
        first = shown["findings"][0]
        assert (first["cause"], first["by_batch"], first["k"]) == (cause, cause != known, 2)


def test_without_ground_truth_an_answer_that_the_batch_doubts_is_no_answer_without_a_doubt():
    branch = run(FakeTools)
    (own,) = view.finished_objects(branch)[:1]
    unknown = replace(own, errors=None, score_at_gt=None)
    assert judged(branch, unknown)["tone"] == "unknown"
    row = answer(findings=(Finding(Cause.IMPOSSIBLE, "12 mm in the table"),))
    shown = judged(branch, unknown, row)
    assert (shown["tone"], shown["words"]) == ("doubt", cause_title(Cause.IMPOSSIBLE))
