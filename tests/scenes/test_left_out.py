"""Objects that are in a frame and cannot be solved: they are named, so that they can be counted as missed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.scenes.bop_folder import Made, cut, detections, image
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import LeftOut
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.source import open_scene


def facts(left_out: tuple[LeftOut, ...]) -> list[tuple[int | None, int, bool, float | None]]:
    return [(one.instance_id, one.obj_id, one.has_truth, one.visib_fract) for one in left_out]


def empty_mask(made: Made) -> None:
    image(made, "mask_visib/000003_000001.png", np.zeros((60, 80), np.uint8))


@pytest.mark.parametrize("what", ["missing", "damaged", "empty"])
def test_a_mask_that_cannot_be_used(made: Made, what: str) -> None:
    file = made.scene / "mask_visib" / "000003_000001.png"
    if what == "missing":
        file.unlink()
    elif what == "damaged":
        cut(file)
    else:
        empty_mask(made)
    problem = made.read()
    assert [i.instance_id for i in problem.instances] == [0, 2]
    assert facts(problem.left_out) == [(1, 5, True, 0.6)]
    said = "its mask is empty, though 60% of it is visible" if what == "empty" else file.name
    assert said in problem.left_out[0].why
    assert problem.left_out[0].is_unreadable == (what != "empty")
    assert [note for note in problem.notes if "obj_000005 (#1) is left out" in note]


def test_what_nobody_can_see_is_not_missed(made: Made) -> None:
    made.edit("scene_gt_info.json", lambda info: info["3"][1].update(visib_fract=0.0))
    empty_mask(made)
    assert made.read().left_out == ()
    assert facts(made.open().all_left_out(made.frame, "no depth")) == [(0, 2, True, 0.5), (2, 2, True, 0.7)]


def test_an_empty_mask_is_believed_where_nothing_else_is_known(made: Made) -> None:
    (made.scene / "scene_gt_info.json").unlink()
    empty_mask(made)
    assert made.read().left_out == ()


def test_a_model_that_is_missing(made: Made) -> None:
    (made.root / "models" / "obj_000005.ply").unlink()
    problem = made.read()
    assert facts(problem.left_out) == [(1, 5, True, 0.6)]
    assert "unknown model 5; available: 2" in problem.left_out[0].why
    np.testing.assert_array_equal(problem.observation.object_mask, made.problem.observation.object_mask)
    assert problem.left_out[0].is_unreadable


def test_a_damaged_model_of_several_detections_leaves_the_others(made: Made) -> None:
    (made.root / "models" / "obj_000002.ply").write_bytes(b"ply\nrubbish")
    file = made.root / "found.json"
    file.write_text(json.dumps(detections(made)))
    problem = made.read(masks=str(file))
    assert [i.obj_id for i in problem.instances] == [5]
    assert [(one.obj_id, one.has_truth, one.is_unreadable) for one in problem.left_out] == [(2, True, True)] * 2


def test_what_was_not_detected(made: Made) -> None:
    file = made.root / "found.json"
    file.write_text(json.dumps(detections(made)[:2]))
    problem = made.read(masks=str(file))
    assert [i.obj_id for i in problem.instances] == [2, 5]
    assert facts(problem.left_out) == [(None, 2, True, 0.7)]
    assert (problem.left_out[0].why, problem.left_out[0].is_unreadable) == ("it was not detected", False)
    assert facts(made.open(masks=str(file)).all_left_out(made.frame, "")) == [
        (None, 2, True, 0.5), (None, 5, True, 0.6), (None, 2, True, 0.7)
    ]  # fmt: skip


def test_a_pose_that_is_no_pose_is_no_truth(made: Made) -> None:
    made.edit("scene_gt.json", lambda gt: gt["3"][1].pop("cam_R_m2c"))
    assert facts(made.open().all_left_out(made.frame, ""))[1] == (1, 5, False, 0.6)


def test_a_frame_that_cannot_be_read_held_what_ground_truth_says(made: Made) -> None:
    (made.scene / "depth" / "000003.png").unlink()
    source = made.open(objects=(2,))
    with pytest.raises(InputError):
        source.problem(made.frame)
    left_out = source.all_left_out(made.frame, "no depth")
    assert facts(left_out) == [(0, 2, True, 0.5), (2, 2, True, 0.7)]
    assert {one.why for one in left_out} == {"no depth"}
    (made.scene / "scene_gt.json").unlink()
    assert made.open().all_left_out(made.frame, "no depth") == ()


@pytest.mark.usefixtures("processes")
def test_a_built_in_scene_knows_its_objects() -> None:
    source = open_scene(SceneSettings(), HypothesesSettings())
    (one,) = source.all_left_out("0/0", "a crash")
    assert (one.instance_id, one.name, one.why, one.has_truth) == (0, "mug", "a crash", True)
