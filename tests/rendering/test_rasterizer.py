"""The CPU rasteriser against closed forms and ray casting."""

from __future__ import annotations

import numpy as np
import pytest

from tests.rendering.witness import CAMERA, box, cast, model_of, shell, table, torus
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.rendering.mesh import render_mesh
from verefine_viz.rendering.rasterizer import draw_frame


def depth_of(model: ObjectModel, T: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
    mesh = render_mesh(model.vertices, model.faces)
    inv_z, face_of = np.zeros(camera.shape, np.float32), np.zeros(camera.shape, np.int32)
    intrinsics = camera.fx, camera.fy, camera.cx, camera.cy
    draw_frame(T, *mesh.arrays, *intrinsics, inv_z, face_of)
    return np.divide(1.0, inv_z, out=np.zeros(camera.shape), where=inv_z > 0)


def test_a_box_covers_the_pixels_that_geometry_says() -> None:
    """Front face at 0.48 m, 60 × 100 mm, about the axis: |u − cx| ≤ 30 mm·f/z, edges included."""
    camera = Camera(np.array([[160.0, 0, 20], [0, 160, 30], [0, 0, 1]]), 41, 61)
    depth = depth_of(box(), transform(np.eye(3), [0, 0, 0.5]), camera)
    v, u = np.mgrid[0:61, 0:41]
    # 0.03·160/0.48 = 10 px and 0.05·160/0.48 = 16.67 px: columns 10 and 30 lie exactly on the edge.
    inside = (np.abs(u - 20) <= 10) & (np.abs(v - 30) <= 16)
    assert np.array_equal(depth > 0, inside)
    assert depth[inside] == pytest.approx(0.48, abs=1e-7)


def test_pixel_centres_are_at_integers() -> None:
    """docs/methods.md 1.8.17: a tilted plane has the depth of the ray through (u, v), not half a pixel further."""
    T = transform(axis_angle([0, 1, 0], 0.9), [0, 0, 0.6])
    depth = depth_of(table(), T)
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    normal, point = T[:3, 2], T[:3, 3] - 0.01 * T[:3, 2]
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    expected = normal @ point / (rays @ normal)
    near_face = (depth > 0) & (np.abs(depth - expected) < 0.01)
    assert near_face.sum() > 10_000
    assert np.abs(depth - expected)[near_face].max() < 1e-6
    half_a_pixel = np.abs(expected - normal @ point / ((rays + np.array([0.5 / CAMERA.fx, 0, 0])) @ normal))[near_face]
    assert half_a_pixel.min() > 1e-5


def test_depth_is_that_of_ray_casting() -> None:
    for model in (torus(), box(), shell(), table()):
        rng = np.random.default_rng(5)
        for _ in range(8):
            T = transform(axis_angle(rng.normal(size=3), rng.uniform(0, np.pi)), [*rng.normal(0, 0.05, 2), 0.5])
            depth, expected = depth_of(model, T), cast([(model, T)], CAMERA)[0]
            assert ((depth > 0) != (expected > 0)).sum() <= 2, model
            both = (depth > 0) & (expected > 0)
            assert (np.abs(depth - expected)[both] > 1e-4).sum() <= 2, model


def test_what_crosses_the_camera_plane_is_clipped_there() -> None:
    rng, n_clear = np.random.default_rng(6), 0
    for model in (table(), torus()):
        for _ in range(8):
            T = transform(axis_angle(rng.normal(size=3), rng.uniform(0, np.pi)), rng.normal(0, 0.02, 3))
            depth, expected = depth_of(model, T), cast([(model, T)], CAMERA)[0]
            # Rays that start inside a triangle's plane, 10 mm before the camera, may see it or not.
            clear = (depth > 0.0101) & (expected > 0.0101)
            n_clear += int(clear.sum())
            assert (np.abs(depth - expected)[clear] > 1e-4).sum() <= 0.001 * clear.size
            assert ((depth > 0) != (expected > 0)).mean() < 0.002
    assert n_clear > 100_000


def test_there_are_no_holes_along_shared_edges() -> None:
    """A plate of many slivers whose edges run through pixel centres."""
    import trimesh

    grid = np.arange(-20, 21) / 160.0 * 0.5
    x, y = np.meshgrid(grid, grid)
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    i = np.arange(40 * 41).reshape(40, 41)[:, :-1].ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 42], 1), np.stack([i, i + 42, i + 41], 1)])
    camera = Camera(np.array([[160.0, 0, 20], [0, 160, 20], [0, 0, 1]]), 41, 41)
    depth = depth_of(model_of(trimesh.Trimesh(vertices, faces)), transform(np.eye(3), [0, 0, 0.5]), camera)
    assert (depth > 0).all()
