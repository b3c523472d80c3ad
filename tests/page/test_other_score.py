"""A run whose score's settings change on the way: each moment is judged by the settings of its own iteration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.fakes import FakeVerifier
from tests.page.conftest import Posted
from tests.page.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.page import protocol as p
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace
from verefine_viz.recording.verify import first_difference


@dataclass(frozen=True)
class ByTolerance(FakeVerifier):
    """A smaller tolerance gives smaller scores."""

    def score(self, target, Ts_cam_obj, placed=()):  # type: ignore[no-untyped-def]
        own = super().score(target, Ts_cam_obj, placed)
        return replace(own, score=own.score * self.settings.tau_m / 0.02)


class Tools(FakeTools):
    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.verifier = ByTolerance(session.score)


SESSION = Session(method=MethodSettings(iterations=3))
STRICTER = {"score.tau_m": 0.005}
MOST = 0.25
"""The largest score by the stricter settings."""


def opened(session: Session = SESSION, posted: Posted | None = None) -> Debugger:
    return Debugger(Workspace(session, None, Tools), Posted() if posted is None else posted)


def test_a_pose_scores_what_the_record_says_at_every_iteration():
    d = opened().carry_out([p.RunVerb(), p.Fork(2, changes=STRICTER, run=True)])
    branch = d.space.branch(1)
    for iteration in branch.run.iterations:
        accepted, target = iteration.accepted_stage, branch.run.problem.target(iteration.instance_id)
        assert accepted.score is not None
        evaluator = branch.evaluator_of(iteration.index)
        assert evaluator.score(target, accepted.T_cam_obj).score == accepted.score.score
        assert (accepted.score.score <= MOST) == (iteration.index > 2)


def test_the_session_of_such_a_run_gives_it_again():
    d = opened().carry_out([p.RunVerb(), p.Fork(2, changes=STRICTER, run=True)])
    again = opened(d.space.session_of(d.space.branch(1))).carry_out([p.RunVerb()])
    assert first_difference(again.space.work.first.run.iterations, d.space.branch(1).run.iterations) is None
    assert [after for after, _ in again.space.work.first.evaluators] == [0, 2]


def test_windows_get_the_initial_poses_of_a_branch_only_where_they_are_others():
    posted = Posted()
    T = (1.0, 0, 0, 0.05, 0, 1, 0, 0.08, 0, 0, 1, 0.7, 0, 0, 0, 1)
    d = opened(posted=posted).carry_out([p.Fork(0, changes={"method.exploration": 0.5})])
    d.carry_out([p.Fork(0, edit=p.EditedPose(0, 1, T))])
    starts = {m["branch"]: m["start"] for m in posted.of("run") if m["from"] == 0}
    assert starts[1] is None
    assert np.allclose(starts[2]["0"][1]["T"], T)
