"""A model that was saved with a frame has the texture that its mesh had."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.fakes import BOX_M, box_problem
from tests.run.kept_frames import assert_same_files, files_in, found, kept, reopened
from verefine_viz.core.errors import InputError
from verefine_viz.scenes.meshes import read_mesh
from verefine_viz.scenes.models import model_of_mesh


def textured_mesh(path: Path, colour: tuple[int, int, int]) -> Path:
    """The box with a texture whose left half has another colour than its right one."""
    image = Image.new("RGB", (8, 8), colour)
    image.paste((9, 9, 200), (0, 0, 4, 8))
    bare = trimesh.creation.box(BOX_M)
    bare.unmerge_vertices()
    uv = bare.vertices[:, :2] / BOX_M[:2] + 0.5
    bare.visual = trimesh.visual.TextureVisuals(uv, image=image)
    bare.export(path)
    return path


def test_an_object_keeps_its_texture(tmp_path: Path) -> None:
    problem = box_problem()
    textured = textured_mesh(tmp_path / "box.glb", (200, 9, 9))
    for _ in range(2):
        kept(tmp_path / "kept", problem, [found(problem, textured)])
    before = model_of_mesh(read_mesh(textured, 1.0), 1, "box", 10, 0)
    after = reopened(tmp_path / "kept").problem("1/2").models[1]
    # The order of faces may have changed, their colours where they are may not.
    rng = np.random.default_rng(0)
    weights = rng.dirichlet([1, 1, 1], len(before.faces))
    points = np.einsum("fk,fkj->fj", weights, before.vertices[before.faces])
    mesh = trimesh.Trimesh(after.vertices, after.faces, process=False)
    nearest, _, faces = trimesh.proximity.closest_point(mesh, points)
    np.testing.assert_allclose(nearest, points, atol=1e-9)
    there = trimesh.triangles.points_to_barycentric(after.vertices[after.faces[faces]], points)
    expected = before.colors(np.arange(len(before.faces)), weights)
    np.testing.assert_allclose(after.colors(faces, there), expected, atol=1)
    assert len(np.unique(expected.round(), axis=0)) > 1
    files = files_in(tmp_path / "kept")
    other = found(problem, textured_mesh(tmp_path / "other.glb", (9, 200, 9)))
    with pytest.raises(InputError, match="box is another mesh than before"):
        kept(tmp_path / "kept", problem, [dict(other, name="box")])
    assert_same_files(files_in(tmp_path / "kept"), files)
