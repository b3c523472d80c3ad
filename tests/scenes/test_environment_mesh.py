"""Surroundings out of a mesh: where it is, what becomes of its flat parts, and what is wrong with a file or a pose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.fakes import box_problem
from verefine_viz.batch.session_check import check
from verefine_viz.core.errors import InputError, SettingsError
from verefine_viz.core.geometry import inverse, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.core.surroundings import Surroundings
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.environment_mesh import mesh_surroundings

PROBLEM = box_problem()
SUPPORT: Any = PROBLEM.observation.support
MIDDLE = (SUPPORT.T_world_cam @ PROBLEM.instances[0].T_cam_obj_gt)[:3, 3]
"""Of the box, 40 mm above the table z = 0."""


def written(folder: Path, mesh: trimesh.Trimesh, scale: float = 1.0) -> str:
    mesh = mesh.copy()
    mesh.apply_scale(scale)
    path = folder / "cell.ply"
    mesh.export(path)
    return str(path)


def table(top_m: float = 0.0, thick_m: float = 0.05) -> trimesh.Trimesh:
    """A board below the box, in the support's world."""
    board = trimesh.creation.box([0.6, 0.4, thick_m])
    board.apply_translation([MIDDLE[0], MIDDLE[1], top_m - thick_m / 2])
    return board


def of_mesh(observation: Observation = PROBLEM.observation, **physics: Any) -> Surroundings:
    return mesh_surroundings(PhysicsSettings(support="mesh", **physics), observation, SUPPORT)


def rows(T: np.ndarray) -> tuple[float, ...]:
    return tuple(T.ravel().tolist())


IN_CAMERA = rows(inverse(SUPPORT.T_world_cam))
"""Pose of the support's world in the camera's frame."""


@pytest.mark.parametrize("unit_m", [1.0, 0.001])
def test_a_mesh_in_the_cameras_frame_and_in_the_worlds_is_the_same(tmp_path: Path, unit_m: float) -> None:
    path = written(tmp_path, table(), 1 / unit_m)
    camera = of_mesh(mesh=path, mesh_unit_m=unit_m, mesh_frame="camera", mesh_pose=IN_CAMERA)
    mapped = replace(PROBLEM.observation, T_map_cam=transform(np.eye(3), [1.0, 2.0, 3.0]) @ SUPPORT.T_world_cam)
    pose = rows(transform(np.eye(3), [1.0, 2.0, 3.0]))
    world = of_mesh(mapped, mesh=path, mesh_unit_m=unit_m, mesh_pose=pose)
    assert len(camera.solids) == len(world.solids) == 6
    for one, other in zip(camera.solids, world.solids, strict=True):
        np.testing.assert_allclose(np.sort(one.vertices, axis=0), np.sort(other.vertices, axis=0), atol=1e-5)
    assert [round(float(s.heights(MIDDLE[None])[0]), 4) for s in world.surfaces] == [0.04]


@pytest.mark.parametrize("start_mm", [5.0, -20.0])
def test_an_object_rests_on_the_mesh_also_from_inside(tmp_path: Path, start_mm: float) -> None:
    """A board whose two top triangles meet below the middle of the object."""
    around = of_mesh(mesh=written(tmp_path, table(0.02)), mesh_frame="camera", mesh_pose=IN_CAMERA)
    support = replace(SUPPORT, surroundings=around)
    model = next(iter(PROBLEM.models.values()))
    start = transform(np.eye(3), [MIDDLE[0], MIDDLE[1], 0.02 + 0.03 + 1e-3 * start_mm])
    moving = Placed(0, model, inverse(SUPPORT.T_world_cam) @ start)
    path = BulletSimulator(PhysicsSettings(collider="hull")).settle(moving, (), support, 120)
    end = SUPPORT.T_world_cam @ path.T_cam_obj
    np.testing.assert_allclose(end[:3, 3], [MIDDLE[0], MIDDLE[1], 0.05], atol=0.002)


def test_an_open_sheet_gets_its_thickness_away_from_the_camera(tmp_path: Path) -> None:
    """A wall behind the box, one sheet."""
    sheet = trimesh.Trimesh([[-0.3, 0, 0], [0.3, 0, 0], [0.3, 0, 0.3], [-0.3, 0, 0.3]], [[0, 1, 2], [0, 2, 3]])
    sheet.apply_translation([MIDDLE[0], MIDDLE[1] + 0.1, 0])
    around = of_mesh(mesh=written(tmp_path, sheet), mesh_frame="camera", mesh_pose=IN_CAMERA)
    assert len(around.solids) == 1
    assert around.surfaces == ()
    y = around.solids[0].vertices[:, 1]
    assert (y.min(), y.max()) == (pytest.approx(MIDDLE[1] + 0.1, abs=1e-4), pytest.approx(MIDDLE[1] + 0.13, abs=1e-4))


def test_the_largest_surface_is_the_first(tmp_path: Path) -> None:
    step = trimesh.creation.box([0.1, 0.1, 0.02])
    step.apply_translation([MIDDLE[0] + 0.2, MIDDLE[1], 0.01])
    both = trimesh.util.concatenate([step, table()])
    around = of_mesh(mesh=written(tmp_path, both), mesh_frame="camera", mesh_pose=IN_CAMERA)
    assert [round(float(s.heights(MIDDLE[None])[0]), 4) for s in around.surfaces] == [0.04, 0.02]
    # Without depth on the objects nothing shows what is near: all of the mesh counts.
    empty = replace(PROBLEM.observation, depth_m=np.zeros_like(PROBLEM.observation.depth_m))
    assert len(of_mesh(empty, mesh=str(tmp_path / "cell.ply"), mesh_frame="camera", mesh_pose=IN_CAMERA).solids) == 12


def test_what_is_wrong_is_refused(tmp_path: Path) -> None:
    moved = table()
    moved.apply_translation([0, 0, 5.0])
    mesh = written(tmp_path, moved)
    for physics, error, words in (
        ({"mesh": ""}, SettingsError, "physics.mesh"),
        ({"mesh": "there/is/none.ply"}, InputError, "none.ply"),
        ({"mesh_frame": "world"}, InputError, "camera"),
        ({"mesh_pose": (1.0, 2.0)}, InputError, "2 numbers, expected 16"),
        ({"mesh_pose": tuple(range(16))}, InputError, "physics.mesh_pose"),
        ({"mesh_unit_m": 0.001}, InputError, "0.5 m"),
    ):
        with pytest.raises(error, match=words):
            of_mesh(**{"mesh_frame": "camera", "mesh": mesh, **physics})
    with pytest.raises(InputError, match=r"cell_9\.ply"):  # Before a batch's first frame.
        check(resolve({"physics": {"support": "mesh", "mesh": str(tmp_path / "cell_9.ply")}}))
    with pytest.raises(SettingsError, match=r"physics\.mesh"):
        resolve({"physics": {"mesh": "cell.ply"}})
