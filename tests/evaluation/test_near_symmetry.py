"""Turns under which a shape nearly looks the same, by shapes whose symmetries are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from tests.made_up_frames import model
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import Cancelled
from verefine_viz.core.geometry import apply, axis_angle, random_unit_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.evaluation import near_symmetry
from verefine_viz.evaluation.near_symmetry import NEAR_SHARE, NearSymmetry, flips, near_symmetries, sought
from verefine_viz.scenes.meshes import Mesh
from verefine_viz.scenes.models import model_of_mesh

HERE = np.eye(4)


def shape(solid: trimesh.Trimesh, T: Float = HERE) -> ObjectModel:
    """The model of a solid that stands anywhere in its frame."""
    vertices = apply(T, np.asarray(solid.vertices, np.float64))
    return model_of_mesh(Mesh(vertices, np.asarray(solid.faces, np.int32), None), 1, "shape", 500, 0)


def anywhere(seed: int) -> Float:
    rng = np.random.default_rng(seed)
    return transform(axis_angle(random_unit_vector(rng), rng.uniform(0, np.pi)), rng.uniform(-0.05, 0.05, 3))


def angles(found: Sequence[NearSymmetry]) -> list[float]:
    return sorted(round(one.angle_deg) for one in found)


@cache
def dense(model: ObjectModel) -> tuple[KDTree, Float]:
    """Points on the model's surface, and some others."""
    solid = trimesh.Trimesh(model.vertices, model.faces, process=False)
    one, other = (trimesh.sample.sample_surface(solid, 40_000, seed=k)[0] for k in (1, 2))
    return KDTree(one), other[:4000]


def shift_m(model: ObjectModel, T: Float) -> float:
    """Mean distance of the surface moved by T from the surface, by dense points: another way to measure."""
    surface, points = dense(model)
    return float(surface.query(apply(T, points))[0].mean() - surface.query(points)[0].mean())


@cache
def prism() -> tuple[NearSymmetry, ...]:
    return sought(shape(trimesh.creation.box((0.1, 0.1, 0.2)), anywhere(3)))


def test_a_box_has_three_half_turns_about_its_middle() -> None:
    T = anywhere(0)
    found = sought(shape(trimesh.creation.box((0.1, 0.06, 0.2)), T))
    assert angles(found) == [180, 180, 180]
    assert not any(one.is_continuous for one in found)
    assert [one.order for one in found] == [2, 2, 2]
    for one in found:
        in_box = T[:3, :3].T @ one.axis
        assert np.abs(in_box).max() > np.cos(np.radians(0.5))
        # The axis goes through the middle.
        assert np.linalg.norm(np.cross(T[:3, 3] - one.centre_m, one.axis)) < 2e-4
        assert one.distance_m < 1e-4


def test_a_square_prism_has_quarter_turns_as_well_and_a_cube_23_turns() -> None:
    assert angles(prism()) == [90, 90, 180, 180, 180, 180, 180]
    assert sorted(one.order or 0 for one in prism()) == [2, 2, 2, 2, 2, 4, 4]
    found = sought(shape(trimesh.creation.box((0.1, 0.1, 0.1)), anywhere(4)))
    assert angles(found) == [90] * 6 + [120] * 8 + [180] * 9


def test_a_cylinder_can_be_turned_by_any_angle_and_turned_over() -> None:
    T = anywhere(5)
    cylinder = shape(trimesh.creation.cylinder(0.04, 0.12, sections=96), T)
    round_axis, over = sought(cylinder)
    assert round_axis.is_continuous
    assert round_axis.order is None
    assert abs(round_axis.axis @ T[:3, 2]) > np.cos(np.radians(0.5))
    assert not over.is_continuous
    assert over.order == 2
    assert abs(over.axis @ T[:3, 2]) < np.sin(np.radians(1))
    # Every turn that stands for them leaves the surface where it was.
    turns = flips((round_axis, over))
    assert len(turns) == 2 * len(near_symmetry.TURNS_DEG) + 1
    assert max(shift_m(cylinder, turn) for turn in turns) < 0.001 * cylinder.diameter_m


def test_a_cone_cannot_be_turned_over_and_a_ball_has_axes_everywhere() -> None:
    assert [one.is_continuous for one in sought(shape(trimesh.creation.cone(0.04, 0.1, sections=96), anywhere(6)))] == [
        True
    ]
    ball = sought(shape(trimesh.creation.icosphere(4, 0.05), anywhere(7)))
    assert len(ball) == near_symmetry.AXES_OF_BALL
    assert all(one.is_continuous for one in ball)


def test_a_mug_is_round_but_for_its_handle() -> None:
    mug = model("mug", symmetric=False)
    found = sought(mug)
    assert [one.is_continuous for one in found] == [True, False]
    assert abs(found[0].axis[2]) > np.cos(np.radians(2))
    assert 0.002 < found[0].distance_m / mug.diameter_m < NEAR_SHARE
    # Turned over, its floor lies where it is open: not much of a thin wall.
    assert found[1].order == 2
    assert abs(found[1].axis @ found[0].axis) < 0.1
    assert found[1].distance_m > 0.005 * mug.diameter_m


def test_a_random_solid_has_none() -> None:
    for seed in range(2):
        corners = np.random.default_rng(seed).normal(size=(12, 3)) * [0.03, 0.05, 0.08]
        assert sought(shape(trimesh.convex.convex_hull(corners))) == (), seed


def test_the_distance_is_that_of_the_surfaces() -> None:
    """A box with one slanted face: turned over it stays apart by what an independent measure shows."""
    box = trimesh.creation.box((0.1, 0.06, 0.2)).subdivide().subdivide().subdivide()
    vertices = np.array(box.vertices)
    vertices[:, 2] += np.where(vertices[:, 2] > 0.09, 0.1 * vertices[:, 0], 0)
    slanted = shape(trimesh.Trimesh(vertices, box.faces, process=False))
    found = [one for one in sought(slanted) if one.distance_m > 1e-4]
    assert found
    for one in found:
        assert one.distance_m < NEAR_SHARE * slanted.diameter_m
        assert shift_m(slanted, one.T_obj_obj) == pytest.approx(one.distance_m, abs=3e-4)


def test_turns_are_closed_under_repetition() -> None:
    turns = Rotation.from_matrix(np.concatenate([np.eye(3)[None], flips(prism())[:, :3, :3]]))
    for one in turns:
        for other in turns:
            assert min((one * other * again.inv()).magnitude() for again in turns) < np.radians(1)


def test_they_are_sought_once_and_again_where_the_file_is_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    box, known = shape(trimesh.creation.box((0.1, 0.06, 0.2))), prism()
    asked: list[bool] = []
    monkeypatch.setattr(near_symmetry, "sought", lambda *_: asked.append(True) or known)
    first, again = near_symmetries(box, tmp_path), near_symmetries(box, tmp_path)
    assert len(asked) == 1
    assert all(np.array_equal(a.T_obj_obj, b.T_obj_obj) for a, b in zip(first, again, strict=True))
    assert [a.distance_m for a in first] == [b.distance_m for b in again]
    (file,) = tmp_path.glob("*.npz")
    content = file.read_bytes()
    np.savez(file, T_obj_obj=np.full((1, 4, 4), np.nan), distance_m=np.zeros(1), is_continuous=np.zeros(1, bool))
    for damaged in (file.read_bytes(), content[: len(content) // 2]):
        file.write_bytes(damaged)
        near_symmetries(box, tmp_path)
        assert file.read_bytes() == content
    assert len(asked) == 3
    (tmp_path / "taken").write_text("a file where the folder should be")
    assert near_symmetries(box, tmp_path / "taken") == known  # It costs only time.


def test_the_search_ends_early_once_it_is_not_wanted(tmp_path: Path) -> None:
    asked = iter([True] * 3 + [False] * 100)
    with pytest.raises(Cancelled):
        near_symmetries(
            shape(trimesh.creation.box((0.1, 0.06, 0.2))), tmp_path, ProgressToken(is_wanted=lambda: next(asked))
        )
    assert not list(tmp_path.glob("*.npz"))


def test_colour_and_declared_symmetries_change_nothing() -> None:
    can = model("can")
    bare = replace(can, symmetries=np.eye(4)[None], vertex_colors=None)
    assert [one.T_obj_obj.tolist() for one in sought(can)] == [one.T_obj_obj.tolist() for one in sought(bare)]
