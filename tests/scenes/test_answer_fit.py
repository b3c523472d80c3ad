"""Where no true pose is known, the poses that were found tell of a wrong camera, and of nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.scenes.sizes import scene, with_focal, written
from verefine_viz.core.camera import Camera
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, SceneSettings, Session
from verefine_viz.scenes.answer_fit import answer_notes
from verefine_viz.session.toolbox import Toolbox
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.debugger import Debugger
from verefine_viz.viewer.text.findings import findings

CLUTTER = scene()


class WithoutTruth(Toolbox):
    """A data set without ground truth, but for its first poses."""

    def problem(self, frame: str) -> Problem:
        problem = super().problem(frame)
        return replace(problem, instances=tuple(replace(i, T_cam_obj_gt=None) for i in problem.instances))


@pytest.mark.parametrize(("focal", "said"), [(0.8, "too small, about 1.2"), (1.0, ""), (1.25, "too large, about 0.8")])
def test_a_wrong_focal_length_is_told_after_the_run(tmp_path: Path, focal: float, said: str) -> None:
    folder = written(tmp_path / "clutter", [CLUTTER], focal)
    session = Session(
        scene=SceneSettings(source="bop", dataset=str(folder)),
        hypotheses=HypothesesSettings(max_per_object=2, rotation_deg=15, translation_mm=15),
        method=MethodSettings(name="rir", iterations=2),
    )
    debugger = Debugger(session, None, WithoutTruth)
    assert not debugger.view(deep=False).doubts, "nothing was found yet"
    view = debugger.carry_out([c.RunUntil("end")]).view(deep=False)
    assert bool(view.doubts) == bool(said)
    first = findings(view)[:1]
    assert bool(first and "fx and fy of cam_K look" in first[0].text) == bool(said)
    assert all(said in one for one in view.doubts)


def test_a_single_object_tells_nothing() -> None:
    camera = with_focal(CLUTTER.observation.camera, 0.85)
    blind = tuple(replace(i, T_cam_obj_gt=None, hypotheses=()) for i in CLUTTER.instances)
    seen = replace(CLUTTER, observation=replace(CLUTTER.observation, camera=camera), instances=blind)
    answers = [i.T_cam_obj_gt for i in CLUTTER.instances]
    (note,) = answer_notes(seen, answers)
    assert "larger than their models in the poses that were found" in note
    assert not answer_notes(seen.only([blind[0].instance_id]), answers[:1])


def test_one_wrong_focal_length_is_told_by_the_shape_of_what_was_found() -> None:
    camera = CLUTTER.observation.camera
    blind = tuple(replace(i, T_cam_obj_gt=None, hypotheses=()) for i in CLUTTER.instances)
    answers = [i.T_cam_obj_gt for i in CLUTTER.instances]

    def said(fx: float, fy: float, dx: float) -> tuple[str, ...]:
        K = camera.K * [[fx, 1, 1], [1, fy, 1], [1, 1, 1]] + [[0, 0, dx], [0, 0, 0], [0, 0, 0]]
        observation = replace(CLUTTER.observation, camera=Camera(K, camera.width, camera.height))
        return answer_notes(replace(CLUTTER, observation=observation, instances=blind), answers)

    (note,) = said(1.2, 1.0, 0.0)
    assert "narrower than their models: fx of cam_K looks too large, about 0.8" in note
    (note,) = said(1.0, 0.8, 0.0)
    assert "higher than their models: fy of cam_K looks too small, about 1.2" in note
    assert not said(1.0, 1.0, 40.0), "objects found beside their masks say nothing of sizes"
