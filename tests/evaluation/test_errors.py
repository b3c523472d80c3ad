"""Pose errors: laws, symmetries, and the official toolkit's numbers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import box_model
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.evaluation.rotation_errors import rotation_error_deg

MODEL = box_model()
angles = st.floats(0, np.pi, allow_nan=False)
vectors = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


@settings(max_examples=50, deadline=None)
@given(vectors, angles, vectors, vectors)
def test_a_known_disturbance_is_measured(axis, angle, offset, t) -> None:  # type: ignore[no-untyped-def]
    T_gt = transform(axis_angle(t, 1.0), t)
    T_est = np.array(T_gt)
    T_est[:3, :3] = T_gt[:3, :3] @ axis_angle(axis, angle)
    T_est[:3, 3] += offset
    errors = pose_errors(MODEL, T_est, T_gt)
    assert abs(errors.rotation_deg - np.rad2deg(angle)) < 1e-6
    assert abs(errors.translation_mm - 1e3 * np.linalg.norm(offset)) < 1e-6
    assert errors.adds_mm <= errors.add_mm + 1e-9
    assert errors.add_s_mm == errors.add_mm


def test_a_pure_translation_is_its_own_add_and_symmetric_poses_are_no_error() -> None:
    errors = pose_errors(MODEL, transform(np.eye(3), [0.003, 0.004, 1]), transform(np.eye(3), [0, 0, 1]))
    assert abs(errors.add_mm - 5.0) < 1e-9
    assert errors.rotation_deg < 1e-9
    assert abs(errors.relative - 5.0 / (MODEL.diameter_m * 1e3)) < 1e-12
    half_turn = transform(axis_angle([0, 0, 1], np.pi), [0, 0, 0])
    model = replace(MODEL, symmetries=np.array([np.eye(4), half_turn]))
    T_gt = transform(axis_angle([1, 2, 3], 0.7), [0.1, 0.2, 0.9])
    assert rotation_error_deg(model, T_gt @ half_turn, T_gt) < 1e-6
    assert abs(rotation_error_deg(MODEL, T_gt @ half_turn, T_gt) - 180) < 1e-6
    errors = pose_errors(model, T_gt @ half_turn, T_gt)
    assert errors.add_s_mm == errors.adds_mm < errors.add_mm


def test_the_official_toolkit_agrees(shared_data: Path) -> None:
    import trimesh

    vectors = json.loads((shared_data / "bop_vectors" / "vectors.json").read_text())
    checked = 0
    for case in vectors["cases"]:
        if "add" not in case or "mesh" not in case:
            continue
        mesh = trimesh.load(shared_data / "bop_vectors" / "meshes" / f"{case['mesh']}.ply", process=False)
        points = np.asarray(mesh.vertices) / 1e3
        model = replace(MODEL, points=points, point_normals=np.zeros_like(points))
        T_est = transform(np.reshape(case["R_est"], (3, 3)), np.ravel(case["t_est"]) / 1e3)
        T_gt = transform(np.reshape(case["R_gt"], (3, 3)), np.ravel(case["t_gt"]) / 1e3)
        errors = pose_errors(model, T_est, T_gt)
        assert abs(errors.add_mm - case["add"]) < 1e-6
        assert abs(errors.adds_mm - case["adi"]) < 1e-6
        checked += 1
    assert checked > 20
