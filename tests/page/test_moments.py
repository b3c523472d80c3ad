"""What a window looks at: stages that hide what comes after them, the end, names of objects that are there twice."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from tests.page.conftest import SESSION
from tests.page.fake_tools import FakeTools
from verefine_viz.core.settings import MethodSettings
from verefine_viz.page import protocol as p
from verefine_viz.page.moment import labels_of, moment_of
from verefine_viz.page.verbs import Debugger
from verefine_viz.page.workspace import Workspace


def opened(name: str = "rir", frame: str = "0/2") -> Debugger:
    session = structs.replace(SESSION, method=MethodSettings(name=name, iterations=3))
    return Debugger(Workspace(session, None, FakeTools, frame=frame))


def test_before_its_last_stage_an_iteration_has_no_result():
    branch = opened(frame="0/1").carry_out([p.RunVerb()]).space.work.first
    for iteration in branch.run.iterations:
        names = [stage.name for stage in iteration.stages]
        for n, name in enumerate(names, 1):
            moment = moment_of(branch, p.Look(k=iteration.index, stage=name))
            shown = [stage for stage in names if stage in moment.poses]
            assert shown == names[:n]
            assert ("accepted" in moment.poses) == (n == len(names))
            best = branch.run.best_at(iteration.index - (n < len(names)))[iteration.instance_id]
            assert np.array_equal(moment.poses["best"], best.T_cam_obj)
            assert np.array_equal(moment.objects[0].T_cam_obj, iteration.stages[n - 1].T_cam_obj) or n == len(names)


@pytest.mark.parametrize("name", ["rir", "pir", "vf_breadth", "vf_depth"])
def test_the_end_shows_the_answers(name: str):
    branch = opened(name).carry_out([p.RunVerb()]).space.work.first
    run = branch.run
    for target, answer in zip(run.problem.targets, run.final_state.best, strict=True):
        assert answer is not None
        moment = moment_of(branch, p.Look(k=run.length, obj=target.instance.instance_id, answer=True))
        assert moment.is_answer
        assert np.array_equal(moment.poses["best"], answer.T_cam_obj)
        assert moment.arm == answer.arm
        assert "accepted" not in moment.poses
        rival = moment.poses.get("runner-up")
        assert rival is None or not np.array_equal(rival, answer.T_cam_obj)
    assert ("runner-up" in moment.poses) == (name in ("rir", "vf_breadth"))


def test_objects_that_are_there_twice_are_told_apart():
    space = opened().space
    assert labels_of(space.problem) == {0: "box #0", 1: "box #1"}
    space.open_frame("0/1")
    assert labels_of(space.problem) == {0: "box"}
