import json
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from tests.observation.planes import CAMERA, angles_deg, tilted
from verefine_viz.core.camera import Camera
from verefine_viz.core.scores import PixelGrid
from verefine_viz.observation.normals import estimate_normals


@given(tilt=st.floats(0, 60), direction=st.floats(0, 360), distance=st.floats(0.3, 2.0))
@settings(max_examples=30, deadline=None)
def test_exact_on_tilted_planes(tilt: float, direction: float, distance: float) -> None:
    depth, normal = tilted(tilt, direction, distance)
    depth[depth > 3] = 0  # nothing measured there: neighbours must not suffer
    normals = estimate_normals(depth.astype(np.float32), CAMERA)
    steep = (np.abs(np.diff(depth, axis=1, append=depth[:, -1:])) > 0.005).any()
    error = angles_deg(normals, normal)
    assert np.max(error) < 0.1
    if not steep:
        assert len(error) == np.count_nonzero(depth)


def test_a_plane_tilted_by_30_degrees_is_tilted_by_30_degrees() -> None:
    """docs/methods.md 1.8.5: gradients per pixel gave 76.7° from millimetres and 0.2° from metres."""
    for direction_deg in (0, 90, 37):
        exact, normal = tilted(30, direction_deg)
        noisy = exact + np.random.default_rng(0).normal(0, 0.001, exact.shape)
        for kind, depth in {"exact": exact, "whole millimetres": np.round(exact, 3), "noisy": noisy}.items():
            normals = estimate_normals(depth.astype(np.float32), CAMERA)
            tilt = angles_deg(normals, np.array([0.0, 0, -1]))
            assert len(tilt) == depth.size, (kind, direction_deg)
            assert np.median(tilt) == pytest.approx(30, abs=1), (kind, direction_deg)
            assert np.median(angles_deg(normals, normal)) < 1.5, (kind, direction_deg)


def test_unit_length_towards_the_camera_and_none_for_pixels_alone() -> None:
    rng = np.random.default_rng(1)
    depth = (0.6 + 0.05 * rng.random(CAMERA.shape)).astype(np.float32)
    depth[rng.random(CAMERA.shape) < 0.1] = 0
    normals = estimate_normals(depth, CAMERA)
    known = (normals != 0).any(axis=-1)
    assert known.sum() > 1000
    assert not known[depth == 0].any()
    assert np.allclose(np.linalg.norm(normals[known], axis=1), 1, atol=1e-6)
    points = CAMERA.back_project(depth)
    assert ((normals * points).sum(axis=-1)[known] < 0).all()
    depth = np.zeros(CAMERA.shape, np.float32)
    depth[10, 10] = depth[50, 60] = depth[50, 61] = 0.7
    assert not estimate_normals(depth, CAMERA).any()
    assert not estimate_normals(np.zeros(CAMERA.shape, np.float32), CAMERA).any()


def test_a_depth_jump_does_not_bend_the_surfaces_beside_it() -> None:
    near, normal_near = tilted(20, 45, 0.6)
    far, normal_far = tilted(35, 200, 0.75)
    left = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width][1] < 150
    normals = estimate_normals(np.where(left, near, far).astype(np.float32), CAMERA)
    assert angles_deg(normals[left], normal_near).max() < 0.1
    assert angles_deg(normals[~left], normal_far).max() < 0.1


def test_normals_of_some_pixels_are_those_of_the_whole_image() -> None:
    rng = np.random.default_rng(5)
    depth = tilted(40, 20)[0] + rng.normal(0, 0.002, CAMERA.shape)
    depth[rng.random(depth.shape) < 0.02] = 0
    depth[40:90, 70:120] -= 0.1
    rows, columns = rng.integers(0, depth.shape[0], 30), rng.integers(0, depth.shape[1], 40)
    at = estimate_normals(depth, CAMERA, at=PixelGrid(rows, columns))
    assert np.array_equal(at, estimate_normals(depth, CAMERA)[np.ix_(rows, columns)])
    assert at.any()


def test_a_turned_image_has_turned_normals() -> None:
    """Rows and columns are treated alike, though they are fitted one after the other."""
    rng = np.random.default_rng(2)
    depth = (0.7 + 0.02 * np.sin(np.mgrid[0:160, 0:160][1] / 9.0) + rng.normal(0, 5e-4, (160, 160))).astype(np.float32)
    camera = Camera(np.array([[500.0, 0, 79.5], [0, 500.0, 79.5], [0, 0, 1]]), 160, 160)
    normals = estimate_normals(depth, camera)
    turned = estimate_normals(np.ascontiguousarray(depth.T), camera)
    inner = (slice(15, -15), slice(15, -15))
    swapped = turned.transpose(1, 0, 2)[..., [1, 0, 2]]
    assert np.median(angles_between(normals[inner], swapped[inner])) < 1.0


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.rad2deg(np.arccos(np.clip((a * b).sum(axis=-1), -1, 1)))


def test_real_frame_agrees_with_the_true_models(shared_data: Path) -> None:
    """Median over an object's pixels of the angle to the normals of its mesh at ground truth, ray cast."""
    folder = shared_data / "ycbv" / "test" / "000049"
    frame = json.loads((folder / "scene_camera.json").read_text())["2365"]
    depth = np.array(Image.open(folder / "depth" / "002365.png")).astype(np.float32) * frame["depth_scale"] / 1000
    camera = Camera(np.array(frame["cam_K"]).reshape(3, 3), depth.shape[1], depth.shape[0])
    normals = estimate_normals(depth, camera)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    for i, truth in enumerate(json.loads((folder / "scene_gt.json").read_text())["2365"]):
        mesh = trimesh.load(shared_data / "ycbv" / "models" / f"obj_{truth['obj_id']:06d}.ply", process=False)
        R, t = np.array(truth["cam_R_m2c"]).reshape(3, 3), np.array(truth["cam_t_m2c"]) / 1000
        scene = o3d.t.geometry.RaycastingScene()
        vertices = (np.asarray(mesh.vertices) / 1000) @ R.T + t
        scene.add_triangles(vertices.astype(np.float32), np.asarray(mesh.faces, np.uint32))
        hit = scene.cast_rays(np.concatenate([np.zeros_like(rays), rays], axis=-1).astype(np.float32))
        true_normals, z = hit["primitive_normals"].numpy(), hit["t_hit"].numpy()
        true_normals = np.where((true_normals * rays).sum(axis=-1, keepdims=True) > 0, -true_normals, true_normals)
        mask = np.array(Image.open(folder / "mask_visib" / f"002365_{i:06d}.png")) > 0
        chosen = mask & (np.abs(z - depth) < 0.01) & (normals != 0).any(axis=-1)
        assert chosen.sum() > 1000
        assert np.median(angles_between(normals[chosen], true_normals[chosen])) < 12
