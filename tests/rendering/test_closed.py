"""Backs of closed surfaces are left out, and nobody can see it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rendering.witness import CAMERA
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.rendering.mesh import RenderMesh, render_mesh
from verefine_viz.rendering.rasterizer import draw_frame
from verefine_viz.rendering.simplify import closed_faces


def box(at: tuple[float, float, float] = (0, 0, 0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.box((0.06, 0.1, 0.04))
    return mesh.apply_translation(at)


def ring() -> trimesh.Trimesh:
    return trimesh.creation.torus(0.05, 0.02)


def inverted(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def open_box() -> trimesh.Trimesh:
    return trimesh.Trimesh(box().vertices, box().faces[2:], process=False)


def one_face_turned() -> trimesh.Trimesh:
    faces = box().faces.copy()
    faces[0] = faces[0][::-1]
    return trimesh.Trimesh(box().vertices, faces, process=False)


def pierced_by_its_own_corner() -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(2, 0.05)
    vertices = ball.vertices.copy()
    vertices[np.argmax(vertices[:, 2])] = (0.005, 0.003, -0.09)
    return trimesh.Trimesh(vertices, ball.faces, process=False)


def together(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(meshes)


def flags(mesh: trimesh.Trimesh) -> np.ndarray:
    return closed_faces(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int32))


def test_solids_are_closed_even_where_they_reach_into_each_other_and_what_shows_its_back_is_not() -> None:
    for mesh in (box(), ring(), together(box(), box((0.02, 0.01, 0)))):
        assert flags(mesh).all(), mesh
    for mesh in (open_box(), inverted(box()), one_face_turned(), pierced_by_its_own_corner()):
        assert not flags(mesh).any(), mesh
    assert closed_faces(np.zeros((3, 3)), np.zeros((0, 3), np.int32)).shape == (0,)


def test_each_part_is_judged_by_itself() -> None:
    mesh = together(box(), open_box().apply_translation([0.1, 0, 0]), ring().apply_translation([0, 0.3, 0]))
    n_box, n_open, n_ring = len(box().faces), len(open_box().faces), len(ring().faces)
    assert np.array_equal(flags(mesh), np.repeat([True, False, True], [n_box, n_open, n_ring]))


def drawn(mesh: RenderMesh, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    inv_z, face_of = np.zeros(CAMERA.shape, np.float32), np.full(CAMERA.shape, -1, np.int32)
    draw_frame(T, *mesh.arrays, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, inv_z, face_of)
    return inv_z, face_of


SCENES = {
    "box": box(),
    "ring": ring(),
    "ring and open box": together(ring(), open_box()),
    "crossing": together(box(), ring().apply_translation([0.02, 0.03, 0.01])),
}


@pytest.mark.parametrize("name", SCENES)
@given(seed=st.integers(0, 2**32 - 1), z=st.floats(0.02, 0.8))
@settings(max_examples=25, deadline=None)
def test_the_picture_is_that_of_all_faces(name: str, seed: int, z: float) -> None:
    """From near as well: where the near plane opens a closed surface, one looks into it."""
    rng = np.random.default_rng(seed)
    vertices, faces = np.asarray(SCENES[name].vertices), np.asarray(SCENES[name].faces, dtype=np.int32)
    mesh = render_mesh(vertices, faces, closed_faces(vertices, faces))
    assert mesh.closed.any()
    T = transform(axis_angle(rng.normal(size=3), rng.uniform(0, np.pi)), [*rng.normal(0, 0.03, 2), z])
    depth, face_of = drawn(mesh, T)
    all_depth, all_faces = drawn(replace(mesh, closed=np.zeros_like(mesh.closed)), T)
    assert np.array_equal(depth, all_depth)
    assert np.array_equal(face_of, all_faces)
