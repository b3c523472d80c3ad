"""What is written as a BOP folder is read back as it was, up to the depth's quantisation."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.scenes.write_bop import write_bop
from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.scenes.source import SceneSource, open_scene


def reopened(folder: Path, split: str = "test", **more) -> SceneSource:
    settings = SceneSettings(source="bop", dataset=str(folder), split=split, model_points=100, **more)
    return open_scene(settings, HypothesesSettings())


def assert_same(got: Problem, want: Problem, depth_scale_mm: float) -> None:
    assert got.frame == want.frame
    assert got.notes == ()
    a, b = got.observation, want.observation
    np.testing.assert_allclose(a.depth_m, b.depth_m, atol=depth_scale_mm * 0.5e-3 + 1e-6)
    np.testing.assert_allclose(a.camera.K, b.camera.K, atol=0)
    np.testing.assert_array_equal(a.object_mask, b.object_mask)
    if b.rgb is None:
        assert a.rgb is None
    else:
        np.testing.assert_array_equal(a.rgb, b.rgb)
    assert [(i.obj_id, i.visib_fract) for i in got.instances] == [(i.obj_id, i.visib_fract) for i in want.instances]
    for i, j in zip(got.instances, want.instances, strict=True):
        np.testing.assert_array_equal(i.mask, j.mask)
        np.testing.assert_allclose(i.T_cam_obj_gt, j.T_cam_obj_gt, atol=1e-14)
    assert got.models.keys() == want.models.keys()
    for obj_id, model in want.models.items():
        back = got.models[obj_id]
        assert back.name == model.name
        assert back.diameter_m == pytest.approx(model.diameter_m, rel=1e-12)
        np.testing.assert_allclose(back.vertices, model.vertices, rtol=1e-14, atol=1e-17)
        np.testing.assert_array_equal(back.faces, model.faces)
        np.testing.assert_allclose(back.symmetries, model.symmetries, atol=1e-12)
        np.testing.assert_array_equal(back.vertex_colors, model.vertex_colors)


@pytest.mark.parametrize("depth_scale_mm", [0.1, 1.0])
def test_write_then_read_is_identity(tmp_path: Path, depth_scale_mm: float) -> None:
    first, second = box_problem(n_instances=2), replace(box_problem(n_instances=3, seed=1), scene_id=4, im_id=17)
    write_bop(tmp_path / "made", [first, second], depth_scale_mm=depth_scale_mm)
    source = reopened(tmp_path / "made")
    assert source.frames == ("0/1", "4/17")
    assert_same(source.problem("0/1"), first, depth_scale_mm)
    assert_same(source.problem("4/17"), second, depth_scale_mm)


def test_colours_symmetries_and_missing_rgb_survive(tmp_path: Path) -> None:
    problem = box_problem()
    turns = np.stack([transform(axis_angle([0, 0, 1], k * np.pi), [0.001 * k, 0, 0]) for k in range(2)])
    colors = np.arange(24, dtype=np.uint8).reshape(8, 3)
    model = replace(problem.models[1], symmetries=turns, vertex_colors=colors, name="a mug & more")
    problem = replace(problem, models={1: model}, observation=replace(problem.observation, rgb=None))
    write_bop(tmp_path, [problem], split="train_made")
    got = reopened(tmp_path, "train_made").problem("0/1")
    assert got.notes == ("the frame has no rgb or gray image; it is drawn without colour",)
    assert_same(replace(got, notes=()), problem, 0.1)


def test_the_support_is_kept_as_the_camera_pose(tmp_path: Path) -> None:
    problem = box_problem()
    write_bop(tmp_path, [problem])
    want = problem.observation.support.T_world_cam
    entry = json.loads((tmp_path / "test" / "000000" / "scene_camera.json").read_text())["1"]
    T_cam_world = transform(np.reshape(entry["cam_R_w2c"], (3, 3)), np.array(entry["cam_t_w2c"]) * 1e-3)
    np.testing.assert_allclose(inverse(T_cam_world), want, atol=1e-12)
    support = reopened(tmp_path, gravity="world").problem("0/1").observation.support
    np.testing.assert_allclose(support.T_world_cam[2, :3], want[2, :3], atol=1e-9)
