"""What another program recorded: its scores beside ours, and going on from its poses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import pearsonr, rankdata

from tests.changing import replace
from tests.page.conftest import Posted
from tests.page.fake_tools import FakeTools
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import ANSWER, Problem, RecordedStep
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.page import protocol as p
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.views.recorded_poses import recorded
from verefine_viz.page.workspace import Workspace

TRACE = Session(method=MethodSettings(name="trace", iterations=2))


class Traced(FakeTools):
    """A box whose hypotheses another program moved towards ground truth, with scores of its own."""

    def problem(self, frame: str, **_: object) -> Problem:
        problem = super().problem(frame)
        (instance, *others) = problem.instances
        T_gt = instance.T_cam_obj_gt
        assert T_gt is not None
        steps = [
            RecordedStep(j, transform(np.eye(3), [0.01 * (4 - k), 0, 0]) @ T_gt, f"step {k}", 10.0 * k + j, 1.5, "note")
            for k in range(3)
            for j in (1, 0)
        ]
        steps.append(RecordedStep(0, T_gt, ANSWER))
        traced = replace(instance, recorded=tuple(steps), recorded_scores=(1.0, None, 2.0))
        return replace(problem, instances=(traced, *others))


@pytest.fixture
def debugger(posted: Posted) -> Debugger:
    return Debugger(Workspace(TRACE, None, Traced), posted).carry_out([])


def test_every_step_stands_beside_our_score_of_its_pose(debugger: Debugger):
    while debugger.is_running:
        debugger.tick()
    run = debugger.space.work.first.run
    (obj,) = [i.instance_id for i in run.problem.instances]
    answer = recorded(debugger.space, p.RecordedWanted(obj), Blobs())
    starts, steps = answer.rows[:3], answer.rows[3:]
    assert [(r.k, r.theirs) for r in starts] == [(0, 1.0), (0, None), (0, 2.0)]
    for row, step, iteration in zip(steps, run.problem.instances[0].recorded, run.iterations, strict=True):
        score = iteration.stages[-1].score
        assert score is not None
        assert (row.k, row.arm) == (iteration.index, step.hypothesis)
        assert (row.name, row.theirs, row.ours) == (step.name, step.score, score.score)
    both = np.array([(r.theirs, r.ours) for r in answer.rows if r.theirs is not None])
    assert answer.rank == pytest.approx(pearsonr(*rankdata(both, axis=0).T)[0])


def test_a_branch_goes_on_from_the_recorded_poses(debugger: Debugger):
    changes = {"method.name": "rir", "method.iterations": 3}
    debugger.carry_out([p.Seek(4), p.Fork(4, changes=changes, run=True)])
    first, second = debugger.space.branches.values()
    assert second.run.iterations[:4] == first.run.iterations[:4]
    assert second.run.length == 9
    assert second.settings.method.name == "rir"
    answer = recorded(debugger.space, p.RecordedWanted(0, second.index), Blobs())
    assert [r.k for r in answer.rows if r.k] == [1, 2, 3, 4], "the rest was computed here"


def test_a_recorded_object_is_refined_from_an_edited_pose(debugger: Debugger):
    while debugger.is_running:
        debugger.tick()
    first = debugger.space.work.first
    pose = tuple(transform(np.eye(3), [0.01, 0.0, 0.7]).ravel().tolist())
    debugger.carry_out([p.Refine(0, pose, first.run.length)])
    new = list(debugger.space.branches.values())[1]
    assert new.settings.method.name == "sir"
    assert new.run.is_done
    assert new.run.length == TRACE.method.iterations
    assert new.run.iterations[0].stages[0].T_cam_obj.ravel().tolist() == list(pose)
