"""Convex parts, centre of mass and inertia, and the cache on disk."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.physics.bodies import angle, ball, box, model, ring
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.physics.colliders import Collider, boxed, build, collider, reduced_hull, signed_distance
from verefine_viz.physics.world import QuietClient, convex_body
from verefine_viz.recording.verify import first_difference
from verefine_viz.scenes.demo_models import demo_model


def test_box_has_its_corners_its_centre_and_its_inertia():
    solid = build(box(0.06, 0.04, 0.1), "decomposition")
    (part,) = solid.parts
    assert len(part) == 8
    np.testing.assert_allclose(np.abs(part), np.tile([0.03, 0.02, 0.05], (8, 1)), atol=1e-12)
    np.testing.assert_allclose(solid.com_obj, 0, atol=1e-12)
    x, y, z = 0.06**2, 0.04**2, 0.1**2
    np.testing.assert_allclose(solid.inertia_m2, sorted([(y + z) / 12, (x + z) / 12, (x + y) / 12]), rtol=1e-9)
    assert solid.mass_from == "mesh"


@given(angle=st.floats(0.1, 3.0), shift=st.floats(-0.2, 0.2))
@settings(max_examples=15, deadline=None)
def test_centre_and_principal_axes_follow_the_mesh(angle: float, shift: float):
    T = transform(axis_angle([1, 2, -1], angle), [shift, 0.1, -shift])
    mesh = trimesh.creation.box([0.06, 0.04, 0.1])
    mesh.apply_transform(T)
    solid = build(model(mesh), "hull")
    np.testing.assert_allclose(solid.com_obj, T[:3, 3], atol=1e-9)
    axes = np.abs(T[:3, :3].T @ solid.T_obj_com[:3, :3])  # a permutation: z is the lightest axis, then x, then y
    np.testing.assert_allclose(axes, np.eye(3)[:, [2, 0, 1]], atol=1e-6)
    assert np.linalg.det(solid.T_obj_com[:3, :3]) == pytest.approx(1)


@given(st.tuples(*[st.floats(0.02, 0.2)] * 3), st.tuples(*[st.floats(-0.1, 0.1)] * 3))
@settings(max_examples=15, deadline=None)
def test_the_box_about_an_object_gives_its_moments_alone(size: tuple[float, ...], at: tuple[float, ...]):
    mesh = trimesh.creation.icosphere(2)
    mesh.apply_scale(np.array(size) / 2)
    mesh.apply_translation(at)
    solid = build(model(mesh), "hull")
    box_of_it = boxed(solid)
    low, high = np.vstack(solid.parts).min(axis=0), np.vstack(solid.parts).max(axis=0)
    x, y, z = (high - low + 0.004) ** 2
    np.testing.assert_allclose(box_of_it.inertia_m2, [(y + z) / 12, (x + z) / 12, (x + y) / 12], rtol=1e-9)
    np.testing.assert_array_equal(box_of_it.T_obj_com, transform(np.eye(3), solid.com_obj))
    assert all(a is b for a, b in zip(box_of_it.parts, solid.parts, strict=True))


def test_the_moments_of_the_box_are_bullets_own(hollow_ring: Collider):
    bullet = QuietClient()
    solid = boxed(hollow_ring)
    body = convex_body(bullet, solid.parts, solid.T_obj_com, 2.0, 0.5, 1e-3)
    np.testing.assert_allclose(bullet.getDynamicsInfo(body, -1)[2], 2.0 * solid.inertia_m2, rtol=1e-4)
    bullet.disconnect()


def test_ring_is_hollow_when_decomposed_and_full_as_a_hull(hollow_ring: Collider):
    hull, center = build(ring(), "hull"), np.zeros((1, 3))
    assert signed_distance(hull.parts, center)[0] < -0.02
    assert signed_distance(hollow_ring.parts, center)[0] > 0.035
    assert hull.deviation_m == pytest.approx(0.040, abs=0.004)  # from the middle of the lid to the inner wall
    assert hollow_ring.deviation_m < 0.005
    assert hollow_ring.note == ""


def drilled() -> trimesh.Trimesh:
    """A disc with a hole that takes 5.8 % of its volume, and is deeper than 5 % of the diameter."""
    return trimesh.creation.annulus(0.012, 0.05, 0.06)


def opened(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The same without one triangle."""
    mesh.update_faces(np.arange(len(mesh.faces)) != 0)
    return mesh


def doubled() -> trimesh.Trimesh:
    """Two rings in one another, whose volumes together are about that of their hull."""
    parts = [trimesh.creation.annulus(0.042, 0.06, 0.05), trimesh.creation.annulus(0.041, 0.06, 0.05)]
    return trimesh.util.concatenate(parts)


def test_only_what_is_nearly_convex_is_its_hull_without_a_decomposition(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr("verefine_viz.physics.colliders.decomposed", lambda name, *_: asked.append(name) or [])
    convex = {"box": box(0.06, 0.04, 0.1), "ball": ball(), "drilled disc": model(drilled())}
    hollow = {"not closed": model(opened(drilled())), "doubled": model(doubled()), "ring": ring(), "L": angle()}
    hollow |= {name: demo_model(name, 100, 0) for name in ("mug", "bottle")}
    for name, thing in (convex | hollow).items():
        asked.clear()
        solid = build(thing, "decomposition")
        assert bool(asked) == (name in hollow), name
        assert first_difference(solid.parts, build(thing, "hull").parts) is None, name


def test_mesh_with_a_hole_takes_its_mass_from_the_parts():
    mesh = trimesh.creation.box([0.06, 0.04, 0.1])
    mesh.update_faces(np.arange(len(mesh.faces)) != 0)
    solid = build(model(mesh), "hull")
    assert solid.mass_from == "parts"
    np.testing.assert_allclose(solid.com_obj, 0, atol=1e-9)
    np.testing.assert_allclose(solid.inertia_m2, build(box(0.06, 0.04, 0.1), "hull").inertia_m2)


@given(seed=st.integers(0, 1000), tolerance=st.sampled_from([1e-4, 1e-3, 5e-3]))
@settings(max_examples=25, deadline=None)
def test_reduced_hull_leaves_no_point_out_by_more_than_its_tolerance(seed: int, tolerance: float):
    points = np.random.default_rng(seed).normal(size=(300, 3)) * [0.05, 0.03, 0.1]
    hull = reduced_hull(points, tolerance)
    assert signed_distance([hull], points).max() <= tolerance + 1e-9
    assert {tuple(p) for p in hull} <= {tuple(p) for p in points}


def test_reduced_hull_of_a_fine_sphere_is_smaller():
    points = np.asarray(trimesh.creation.icosphere(5, 0.05).vertices)
    assert len(reduced_hull(points, 5e-4)) < len(points) / 10


FLAT = {
    "plane": [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]],
    "line": [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]],
    "nearly flat": [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 1e-9]],
}


def test_mesh_without_volume_is_refused_by_name(tmp_path: Path):
    for case in FLAT:
        flat = model(trimesh.Trimesh(FLAT[case], [[0, 1, 2], [1, 3, 2]], process=False), 7, "poster")
        with pytest.raises(ShapeError, match=r"object 7 \(poster\).*solid mesh.*physics\.enabled = false") as caught:
            collider(flat, "decomposition", tmp_path)
        assert "\n" not in str(caught.value), case
        assert list(tmp_path.iterdir()) == [], case


def test_hull_and_decomposition_are_kept_apart_and_not_built_again(
    hollow_ring: Collider, cache: Path, monkeypatch: pytest.MonkeyPatch
):
    hull = collider(ring(), "hull", cache)
    assert len(hull.parts) == 1
    assert len(hollow_ring.parts) > 1
    monkeypatch.setattr("verefine_viz.physics.colliders.build", lambda *_: pytest.fail("built again"))
    assert first_difference(hull, collider(ring(), "hull", cache)) is None
    assert first_difference(hollow_ring, collider(ring(), "decomposition", cache)) is None
    assert {path.suffix for path in cache.iterdir()} == {".npz"}


def test_damaged_cache_is_rebuilt(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    thing = box(0.06, 0.04, 0.1)
    first = collider(thing, "hull", tmp_path)
    (path,) = tmp_path.iterdir()
    intact = path.read_bytes()
    for damage in (b"", b"not a zip", intact[: len(intact) // 2]):
        path.write_bytes(damage)
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            assert first_difference(first, collider(thing, "hull", tmp_path)) is None
        assert f"{path} is damaged; it is made again" in caplog.text, damage[:20]
        assert path.read_bytes() == intact, damage[:20]


def test_cache_that_cannot_be_written_only_warns(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder should be")
    with caplog.at_level(logging.WARNING):
        assert len(collider(box(0.06, 0.04, 0.1), "hull", blocked / "colliders").parts) == 1
    assert "it is not cached: " in caplog.text
