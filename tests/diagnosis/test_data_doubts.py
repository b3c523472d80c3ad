"""A support plane that objects sink into, or float above, together is not what carries them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.sizes import scene, written
from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, MethodSettings, SceneSettings, Session
from verefine_viz.diagnosis.data_doubts import answer_doubts, plane_doubts
from verefine_viz.diagnosis.diagnose import diagnose
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo_models import demo_obj_id

CLUTTER = scene()
TRUE = [i.T_cam_obj_gt for i in CLUTTER.instances]


def raised(by_mm: float) -> Problem:
    """The scene with its plane found too high."""
    support = CLUTTER.observation.support
    assert support is not None
    T = np.array(support.T_world_cam)
    T[:3, 3] -= 1e-3 * by_mm * support.normal_world
    return replace(CLUTTER, observation=replace(CLUTTER.observation, support=replace(support, T_world_cam=T)))


@pytest.mark.parametrize(
    ("by_mm", "said"),
    [(80, "objects sink into the support plane, by"), (-200, "float above the support plane"), (0, ""), (10, "")],
)
def test_a_plane_that_carries_nothing_is_reported(by_mm: float, said: str) -> None:
    notes = plane_doubts(raised(by_mm), TRUE)
    assert [said in note.text for note in notes] == [True] * bool(said)


def test_a_single_answer_or_no_plane_tells_nothing() -> None:
    one: list[Float | None] = [TRUE[0], *[None] * (len(TRUE) - 1)]
    assert not plane_doubts(raised(40), one)
    no_plane = replace(CLUTTER, observation=replace(CLUTTER.observation, support=None))
    assert not plane_doubts(no_plane, TRUE)


def test_one_object_in_a_wrong_pose_is_no_fault_of_the_plane() -> None:
    sunk = np.array(TRUE[0])
    sunk[:3, 3] += CLUTTER.observation.support.T_world_cam[:3, :3].T @ [0, 0, -0.05]  # type: ignore[union-attr]
    assert not plane_doubts(CLUTTER, [sunk, *TRUE[1:]])


def test_poses_far_from_the_measured_depth_tell_nothing_of_the_plane() -> None:
    near_the_camera = [np.array(T) for T in TRUE]
    for T in near_the_camera:
        T[:3, 3] /= 1000
    assert not plane_doubts(CLUTTER, near_the_camera)


def test_the_plane_is_doubted_without_ground_truth_only() -> None:
    problem = raised(80)
    blind = replace(problem, instances=tuple(replace(i, T_cam_obj_gt=None) for i in problem.instances))
    assert "sink into the support plane" in answer_doubts(blind, TRUE)[0].text
    assert not answer_doubts(problem, TRUE)


# Where the data of a frame do not fit together, each diagnosis says so beside its cause.


DOUBT = "objects appear"


@pytest.mark.parametrize("focal", [1.0, 0.75])
def test_a_wrong_focal_length_is_reported_beside_the_cause(tmp_path: Path, focal: float) -> None:
    folder = written(tmp_path / "clutter", [scene()], focal)
    toolbox = Toolbox(
        Session(
            scene=SceneSettings(source="bop", dataset=str(folder), objects=(demo_obj_id("can"),)),
            hypotheses=HypothesesSettings(max_per_object=1, rotation_deg=90, translation_mm=60),
            method=MethodSettings(name="rir", iterations=2),
        )
    )
    run = toolbox.run(toolbox.problem("0/0"))
    run.finish()
    (diagnosis,) = diagnose(run, toolbox, threshold=1e-3)
    assert (DOUBT in " ".join(diagnosis.doubts)) == (focal != 1)
    if focal != 1:
        assert "fx and fy of cam_K look too small, about 1.3" in diagnosis.doubts[0]
