"""``vv.label``: from a rough pose to a verified one, on frames with and without objects of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import verefine_viz as vv
from tests.labels.labelled import bare_dataset, problems
from tests.made_up_frames import Thing, frame_of, model, standing
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.problem import Problem, Target
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.scenes.labels import Label

HULL = {"collider": "hull"}


def moved(target: Target, turn_deg: float, shift_m: tuple[float, float, float]) -> Float:
    """The true pose turned about the vertical, through the object's middle, and shifted."""
    T_gt, support = target.instance.T_cam_obj_gt, target.observation.support
    assert T_gt is not None
    assert support is not None
    middle = apply(T_gt, target.model.middle_m[None])[0]
    R = axis_angle(support.T_world_cam[2, :3], np.radians(turn_deg))
    return transform(R, middle - R @ middle + shift_m) @ T_gt


def named(problem: Problem, name: str) -> Target:
    return next(one for one in problem.targets if one.model.name == name)


def off(target: Target, label: Label) -> tuple[float, float]:
    """ADD(-S) [mm] and rotation [deg] to the truth."""
    assert target.instance.T_cam_obj_gt is not None
    errors = pose_errors(target.model, label.pose, target.instance.T_cam_obj_gt)
    return errors.add_s_mm, errors.rotation_deg


@pytest.mark.usefixtures("processes")
def test_a_rough_pose_comes_right_and_a_wrong_one_does_not_look_verified() -> None:
    frame = vv.open_frame("clutter")
    problem = frame.problem()
    mug = named(problem, "mug")
    right = vv.label(frame, "mug", moved(mug, 20.0, (0.015, -0.01, 0.015)), physics=HULL)
    add_mm, turn_deg = off(mug, right)
    assert (right.light, right.reasons, right.begun) == ("green", (), "given")
    assert add_mm < 2
    assert turn_deg < 2
    assert (right.name, right.obj_id, right.instance) == ("mug", mug.model.obj_id, mug.instance.instance_id)
    assert right.undetermined_deg < 10
    wrong = vv.label(frame, mug.instance.instance_id, moved(mug, 0.0, (0.08, 0.0, 0.0)), physics=HULL)
    assert off(mug, wrong)[0] > 20
    assert wrong.light != "green"
    assert len(wrong.reasons) > 0
    assert wrong.score < 0.5 < right.score
    assert vv.label(frame, "mug", moved(mug, 20.0, (0.015, -0.01, 0.015)), physics=HULL).pose.tobytes() == (
        right.pose.tobytes()
    )


@pytest.fixture
def made() -> Problem:
    return problems(1)[0]


def test_a_frame_of_a_folder_without_truth_is_labelled_by_the_names_of_its_models(
    tmp_path: Path, made: Problem
) -> None:
    frame = vv.open_frame(bare_dataset(tmp_path / "boxes", [made]), "3/0")
    carton = named(made, "carton")
    start = moved(carton, 10.0, (0.01, 0.0, 0.01))
    by_name, by_id = (vv.label(frame, name, start, physics=HULL) for name in ("carton", carton.model.obj_id))
    assert by_name.pose.tobytes() == by_id.pose.tobytes()
    assert by_name.light == "green"
    assert by_name.obj_id == carton.model.obj_id
    assert off(carton, by_name)[0] < 2
    apart = vv.open_frame(tmp_path / "boxes", scene={"source": "labels", "models": str(tmp_path / "boxes" / "models")})
    assert vv.label(apart, "carton", start, physics=HULL).pose.tobytes() == by_name.pose.tobytes()


def test_an_object_does_not_become_another_that_is_given(tmp_path: Path) -> None:
    """Of two cans side by side one starts nearer to the other's place."""
    can = model("can")
    Ts_world = [standing(can, np.random.default_rng(0), 0.0, 0.0) for _ in range(2)]
    Ts_world[1][:3, 3] += [0.07, 0, 0]
    problem = frame_of([Thing(can, T) for T in Ts_world], np.random.default_rng(0))
    trimesh.Trimesh(can.vertices, can.faces).export(tmp_path / "can.ply")
    frame, Ts = vv.Frame(problem.observation.camera.K, problem.observation.depth_m), list[Float]()
    for name, one in zip(("left", "right"), problem.instances, strict=True):
        assert one.T_cam_obj_gt is not None
        frame.add(name, tmp_path / "can.ply", one.mask, one.T_cam_obj_gt)
        Ts.append(one.T_cam_obj_gt)
    start = transform(np.eye(3), 0.7 * (Ts[1] - Ts[0])[:3, 3]) @ Ts[0]
    alone, beside = (vv.label(frame, "left", start, others, physics=HULL) for others in (None, {"right": Ts[1]}))
    assert np.linalg.norm((alone.pose - Ts[1])[:3, 3]) < 0.002
    assert np.linalg.norm((beside.pose - Ts[0])[:3, 3]) < 0.002


def test_what_cannot_be_labelled_is_one_line(tmp_path: Path, made: Problem) -> None:
    folder = bare_dataset(tmp_path / "boxes", [made])
    pose = moved(named(made, "carton"), 0.0, (0.0, 0.0, 0.0))
    skewed = pose.copy()
    skewed[0, 0] += 0.5
    seen, carton = made.observation, named(made, "carton").instance
    (mesh,) = (folder / "models").glob("obj_*09.ply")
    arrays = vv.Frame(seen.camera.K, seen.depth_m).add("carton", mesh, carton.mask, pose, unit_m=0.001)
    for frame in (vv.open_frame(folder, "3/0"), arrays):
        refused = {
            "unknown object 'jag'": ("jag", pose),
            "2 poses, expected one": ("carton", [pose, pose]),
            "pose 0": ("carton", skewed),
            "expected T_cam_obj in metres": ("carton", np.eye(3)),
        }
        for message, (name, T) in refused.items():
            with pytest.raises(vv.VerefineError, match=message) as error:
                vv.label(frame, name, T)
            assert "\n" not in str(error.value)
        with pytest.raises(InputError, match="unknown object 'jug'"):
            vv.label(frame, "carton", pose, {"jug": pose})
    with pytest.raises(InputError, match="no object"):
        vv.label(vv.Frame(seen.camera.K, seen.depth_m), "mug", pose)
