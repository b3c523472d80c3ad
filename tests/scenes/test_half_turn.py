"""Objects turned by half: about which axis, and that a turned scene is another view of nearly the same shapes."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from verefine_viz.core.errors import SettingsError
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.run.session_file import load_session
from verefine_viz.scenes.demo import demo_problem
from verefine_viz.scenes.demo_models import demo_model
from verefine_viz.scenes.half_turn import half_turn
from verefine_viz.scenes.meshes import Mesh
from verefine_viz.scenes.models import model_of_mesh

UP = np.array([0.0, 0.0, 1.0])


def _banana() -> ObjectModel:
    """Half a ring that lies flat, in a frame askew to it."""
    ring = trimesh.creation.torus(0.08, 0.015, major_sections=48, minor_sections=16)
    bow = trimesh.Trimesh(ring.vertices, ring.faces[(ring.triangles_center[:, 0] > 0)], process=True)
    bow.remove_unreferenced_vertices()
    bow.apply_transform(trimesh.transformations.rotation_matrix(0.4, [0, 0, 1], [0.02, 0.01, 0.0]))
    mesh = Mesh(np.asarray(bow.vertices, dtype=np.float64), np.asarray(bow.faces, dtype=np.int32), None)
    return model_of_mesh(mesh, 1, "banana", 1000, 0, None)


def test_a_bow_is_turned_over_and_lies_where_it_lay() -> None:
    banana = _banana()
    T = half_turn(banana, UP)
    np.testing.assert_allclose(T[:3, :3] @ UP, -UP, atol=0.05)
    before, after = banana.vertices, apply(T, banana.vertices)
    np.testing.assert_allclose(after.min(axis=0), before.min(axis=0), atol=0.004)
    np.testing.assert_allclose(after.max(axis=0), before.max(axis=0), atol=0.004)


@pytest.mark.parametrize("name", ["duck", "mug", "cereal"])
def test_other_objects_are_turned_round(name: str) -> None:
    T = half_turn(demo_model(name, 1000, 0), UP)
    np.testing.assert_allclose(T[:3, :3], np.diag([-1.0, -1.0, 1.0]), atol=1e-9)


@pytest.mark.usefixtures("long_run")
def test_a_turned_scene_has_its_objects_in_place() -> None:
    given, turned = (
        demo_problem("clutter", SceneSettings(demo="clutter", turned=is_turned), HypothesesSettings())
        for is_turned in (False, True)
    )
    for before, after in zip(given.instances, turned.instances, strict=True):
        model = given.models[before.obj_id]
        there = KDTree(apply(before.T_cam_obj_gt, model.points)).query(apply(after.T_cam_obj_gt, model.points))[0]
        assert np.median(there) < 0.05 * model.diameter_m
        turn = before.T_cam_obj_gt[:3, :3].T @ after.T_cam_obj_gt[:3, :3]
        assert np.trace(turn) == pytest.approx(-1.0, abs=0.02)


def test_objects_of_a_data_set_cannot_be_turned(tmp_path: Path) -> None:
    file = tmp_path / "photos.toml"
    file.write_text('[scene]\nsource = "bop"\ndataset = "d"\n')
    with pytest.raises(SettingsError, match=r'scene.turned is set, but scene.source is "bop"'):
        load_session(file, {"scene": {"turned": True}})
