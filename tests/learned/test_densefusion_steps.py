"""DenseFusion's poses and steps with networks made by hand, against plain algebra."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.learned.tiny_network import DENSEFUSION_COLOURS, pose_network, refine_network
from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import quat_wxyz, random_unit_vector, rotation_of_quat_wxyz, transform
from verefine_viz.core.problem import Target
from verefine_viz.learned.densefusion_steps import (
    LINEMOD,
    YCBV,
    YCBV_SHIFTS_MM,
    Colours,
    DenseFusionPose,
    DenseFusionSteps,
    rotations_of,
)

QUAT = np.array([0.4, -0.8, 0.2, 1.0])
OFFSET = np.array([0.01, -0.02, 0.03])
POSE = transform(rotation_of_quat_wxyz([0.9, 0.1, -0.3, 0.2]), [0.02, -0.05, 0.7])


def coloured_target(obj_id: int = 1) -> Target:
    target = box_problem().targets[0]
    o = target.observation
    rgb = np.random.default_rng(0).integers(0, 256, (*o.camera.shape, 3)).astype(np.uint8)
    return Target(replace(o, rgb=rgb), replace(target.instance, obj_id=obj_id), replace(target.model, obj_id=obj_id))


def pose_of(folder: Path, content: bytes, **settings: Any) -> DenseFusionPose:
    (folder / "pose.onnx").write_bytes(content)
    return DenseFusionPose(folder / "pose.onnx", DenseFusionSettings(**settings))


def steps_of(folder: Path, content: bytes, **settings: Any) -> DenseFusionSteps:
    (folder / "refine.onnx").write_bytes(content)
    return DenseFusionSteps(folder / "refine.onnx", DenseFusionSettings(**settings))


def some_colours(rng: np.random.Generator, T: np.ndarray) -> Colours:
    points = rng.normal(size=(50, 3)) * 0.05 @ T[:3, :3].T + T[:3, 3]
    return Colours(points[None], np.zeros((1, DENSEFUSION_COLOURS, 50)))


def test_a_points_pose_is_its_quaternion_and_the_point_with_its_offset(tmp_path: Path) -> None:
    target = coloured_target()
    towards = np.array([0.0, 0.0, 5.0])
    net = pose_of(tmp_path, pose_network(QUAT, OFFSET, towards, 3, classes=[7, 1, 4], points=200))
    poses = net.poses(target)
    assert len(poses.Ts_cam_obj) == 200
    assert np.allclose(poses.Ts_cam_obj[:, :3, :3], rotation_of_quat_wxyz(QUAT / np.linalg.norm(QUAT)), atol=1e-6)
    points = poses.Ts_cam_obj[:, :3, 3] - OFFSET
    assert np.allclose(points, poses.colours.points[0], atol=1e-6)
    assert np.allclose(poses.confidences, 1 / (1 + np.exp(-points @ towards)), atol=1e-5)
    o = target.observation
    cloud = o.camera.back_project(o.depth_m)[target.instance.mask & (o.depth_m > 0)]
    assert np.abs(points[:, None] - cloud[None]).sum(axis=2).min(axis=1).max() < 1e-5


def test_steps_are_carried_out_in_the_frame_of_the_pose(tmp_path: Path) -> None:
    """Against the paper's formula, worked out with whole matrices: T ← T [R(q') | t'], points seen from the object."""
    rng = np.random.default_rng(1)
    for follow in (0.0, 0.5, -1.3):
        net = steps_of(tmp_path, refine_network(QUAT, follow, 3, classes=[7, 1, 4]))
        colours, expected = some_colours(rng, POSE), POSE
        for _ in range(3):
            homogeneous = np.concatenate([colours.points[0], np.ones((50, 1))], axis=1)
            middle = (np.linalg.inv(expected) @ homogeneous.T).T[:, :3].mean(axis=0)
            expected = expected @ transform(rotation_of_quat_wxyz(QUAT / np.linalg.norm(QUAT)), follow * middle)
        result = net.refined(POSE, colours, coloured_target(4).model, 3)
        np.testing.assert_allclose(result, expected, atol=1e-5)
        assert np.allclose(result[:3, :3] @ result[:3, :3].T, np.eye(3), atol=1e-12)


def test_a_step_of_nothing_leaves_the_pose_where_it_is(tmp_path: Path) -> None:
    """Also where the official weights mean models that are shifted against those of the frame."""
    net = steps_of(tmp_path, refine_network(np.array([1.0, 0, 0, 0]), 0.0, 21))
    for obj_id in (1, 17):
        colours, model = some_colours(np.random.default_rng(0), POSE), coloured_target(obj_id).model
        np.testing.assert_allclose(net.refined(POSE, colours, model, 2), POSE)


def test_official_ycbv_poses_are_moved_to_bops_models(tmp_path: Path) -> None:
    """A point of the original model and the same point of BOP's, which lies a shift further, are one in the camera."""
    target = coloured_target(5)
    official = pose_of(tmp_path, pose_network(QUAT, OFFSET, OFFSET, 21)).poses(target)
    plain = pose_of(tmp_path, pose_network(QUAT, OFFSET, OFFSET, 21), classes=tuple(range(1, 22)), points=1000)
    ours = plain.poses(target)
    point = np.array([0.01, 0.02, -0.03, 1.0])
    moved = point + np.append(YCBV_SHIFTS_MM[4], 0) / 1000
    np.testing.assert_allclose(official.Ts_cam_obj @ moved, ours.Ts_cam_obj @ point, atol=1e-9)


def test_classes_and_points_of_official_weights_are_known(tmp_path: Path) -> None:
    lm, ycbv = (pose_of(tmp_path, pose_network(QUAT, OFFSET, OFFSET, n)).classes for n in (13, 21))
    assert lm == LINEMOD
    assert ycbv == YCBV
    assert (lm.n_points, ycbv.n_points) == (500, 1000)
    assert not {3, 7} & set(lm.obj_ids)


def test_another_number_of_classes_is_one_line(tmp_path: Path) -> None:
    for n_classes, settings, said in (
        (21, {"classes": (1, 2)}, "have 21 classes, densefusion.classes names 2 objects"),
        (7, {}, "have 7 classes, neither the 21 of YCB-Video nor the 13 of LINEMOD; name the ids"),
    ):
        with pytest.raises(InputError, match=re.escape(said)) as raised:
            pose_of(tmp_path, pose_network(QUAT, OFFSET, OFFSET, n_classes), **settings)
        assert "\n" not in str(raised.value), said
        with pytest.raises(InputError, match=re.escape(said)):
            steps_of(tmp_path, refine_network(QUAT, 0.0, n_classes), **settings)


def test_unknown_objects_frames_without_colour_and_the_wrong_network_are_one_line(tmp_path: Path) -> None:
    net = pose_of(tmp_path, pose_network(QUAT, OFFSET, OFFSET, 2, classes=[4, 6]))
    with pytest.raises(InputError, match=r"pose\.onnx: unknown object 1; available: 4, 6"):
        net.poses(coloured_target(1))
    net = pose_of(tmp_path, pose_network(QUAT, OFFSET, OFFSET, 1, classes=[1]))
    target = coloured_target()
    with pytest.raises(InputError, match="needs a colour image, and this frame has none"):
        net.poses(replace(target, observation=replace(target.observation, rgb=None)))
    with pytest.raises(
        InputError, match=r"densefusion_refine, .* expected densefusion_pose, .* train densefusion writes"
    ):
        pose_of(tmp_path, refine_network(QUAT, 0.0, 1))


def test_answers_that_are_no_pose_are_one_line(tmp_path: Path) -> None:
    for quat, said in (([np.nan] * 4, "give NaN or infinity"), ([0.0] * 4, "give a quaternion without length")):
        with pytest.raises(InputError, match=said):
            pose_of(tmp_path, pose_network(np.array(quat), OFFSET, OFFSET, 1, classes=[1])).poses(coloured_target())
        steps = steps_of(tmp_path, refine_network(np.array(quat), 0.0, 1, classes=[1]))
        with pytest.raises(InputError, match=said):
            steps.refined(POSE, some_colours(np.random.default_rng(0), POSE), coloured_target().model, 1)


def test_rotations_of_quaternions_of_any_length(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    network = pose_of(tmp_path, pose_network(QUAT, OFFSET, OFFSET, 1, classes=[1])).network
    quats = np.stack([random_unit_vector(rng) for _ in range(40)])
    quats = np.concatenate([rng.normal(size=(40, 1)), quats], axis=1) * rng.uniform(0.01, 50, (40, 1))
    Rs = rotations_of(quats, network)
    for R, quat in zip(Rs, quats, strict=True):
        unit = quat / np.linalg.norm(quat)
        np.testing.assert_allclose(np.abs(quat_wxyz(R) @ unit), 1, atol=1e-9)
