"""Convex parts that a file gives stand for a model in place of those that are worked out."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.physics.bodies import ball, box, heights, placed, ring, standing, table
from verefine_viz.core.errors import InputError
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.colliders import build
from verefine_viz.physics.given_parts import given_collider
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.recording.verify import first_difference


def written(folder: Path, obj_id: int, parts: tuple[np.ndarray, ...], unit_m: float = 1.0, word: str = "o") -> Path:
    """Write parts as V-HACD does: an object or a group each, vertices counted through the file."""
    lines, n = [], 1
    for k, part in enumerate(parts):
        hull = trimesh.convex.convex_hull(part)
        lines += [f"{word} convex_{k}", *(f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in hull.vertices / unit_m)]
        lines += ["f " + " ".join(str(n + i) for i in face) for face in hull.faces]
        n += len(hull.vertices)
    path = folder / f"obj_{obj_id:06d}.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


RING = dataclasses.replace(ring(), obj_id=5)


def sectors(n: int = 12) -> tuple[np.ndarray, ...]:
    """Return the convex parts of the ring: wedges of two sides each of its polygon."""
    corners = RING.vertices
    angles = np.round(np.arctan2(corners[:, 1], corners[:, 0]) / (2 * np.pi / 24)) % 24
    return tuple(corners[np.isin(angles, [2 * k, 2 * k + 1, (2 * k + 2) % 24])] for k in range(n))


@pytest.mark.parametrize(("word", "unit_m"), [("o", 1.0), ("g", 0.001)])
def test_each_object_of_a_file_is_a_part(tmp_path: Path, word: str, unit_m: float):
    model, parts = RING, sectors()
    written(tmp_path, model.obj_id, parts, unit_m, word)
    given = given_collider(model, tmp_path, unit_m)
    assert given is not None
    assert len(given.parts) == len(parts)
    ends = [sorted((*part.min(axis=0), *part.max(axis=0)) for part in those) for those in (parts, given.parts)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)
    np.testing.assert_allclose(given.inertia_m2, build(model, "hull").inertia_m2, rtol=1e-9)
    assert given.deviation_m < 0.2 * build(model, "hull").deviation_m


def test_a_ball_falls_into_the_ring_that_a_file_keeps_hollow(tmp_path: Path):
    written(tmp_path, RING.obj_id, sectors())
    start, under = placed(ball(), (0, 0, 0.075)), [standing(RING, instance_id=1)]
    ends = []
    for folder in (str(tmp_path), ""):
        simulator = BulletSimulator(PhysicsSettings(collider="hull", collider_folder=folder), tmp_path / "cache")
        ends.append(heights(ball(), simulator.settle(start, under, table(), 120).Ts_cam_obj[-1]).min())
    np.testing.assert_allclose(ends, [0, 0.05], atol=0.003)


def test_a_model_without_a_file_is_taken_apart_as_ever(tmp_path: Path):
    written(tmp_path, 7, sectors())
    solid = box(0.06, 0.04, 0.1)
    simulator = BulletSimulator(PhysicsSettings(collider_folder=str(tmp_path)), tmp_path / "cache")
    assert given_collider(solid, tmp_path, 1.0) is None
    assert first_difference(simulator.collider(solid), build(solid, "decomposition")) is None


def test_what_does_not_fit_is_refused_with_what_would(tmp_path: Path):
    model = RING
    path = written(tmp_path, model.obj_id, sectors(), 0.001)
    with pytest.raises(InputError, match=r"does not lie on the mesh.*collider_unit_m = 0\.001"):
        given_collider(model, tmp_path, 1.0)
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match=rf"collider {path}"):
        given_collider(model, tmp_path, 1.0)
    with pytest.raises(InputError, match="is no folder"):
        given_collider(model, tmp_path / "nothing", 1.0)
