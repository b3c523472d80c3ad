"""Silhouettes of poses, and whose mask one belongs to."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.fakes import BOX_M, box_model, box_problem
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import transform
from verefine_viz.scenes.segments import best_owner, overlap, silhouette

CAMERA = Camera(np.array([[400.0, 0, 160], [0, 400, 120], [0, 0, 1]]), 320, 240)


def test_a_box_seen_straight_on_is_its_front_rectangle() -> None:
    z = 0.8
    outline = silhouette(box_model(), transform(np.eye(3), [0, 0, z]), CAMERA)
    front = z - BOX_M[2] / 2
    half_u, half_v = CAMERA.fx * BOX_M[0] / 2 / front, CAMERA.fy * BOX_M[1] / 2 / front
    v, u = np.mgrid[0:240, 0:320]
    expected = (np.abs(u - 160) <= half_u) & (np.abs(v - 120) <= half_v)
    np.testing.assert_array_equal(outline, expected)


def test_nothing_is_seen_behind_the_camera_or_far_outside() -> None:
    for t in ([0, 0, -0.8], [50.0, 0, 0.8], [0, 1e9, 0.8]):
        assert not silhouette(box_model(), transform(np.eye(3), t), CAMERA).any()


small = hnp.arrays(np.bool_, (6, 7))


@settings(max_examples=100, deadline=None)
@given(small, small)
def test_overlap_is_a_symmetric_share(a: np.ndarray, b: np.ndarray) -> None:
    assert overlap(a, b) == overlap(b, a)
    assert 0 <= overlap(a, b) <= 1
    assert overlap(a, a) == (1 if a.any() else 0)
    assert overlap(a, ~a) == 0


@settings(max_examples=30, deadline=None)
@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.integers(0, 2))
def test_a_nearly_right_pose_belongs_to_its_own_box(dx: float, dy: float, k: int) -> None:
    problem = box_problem(n_instances=3)
    truth = problem.instances[k].T_cam_obj_gt
    pose = transform(np.eye(3), [dx, dy, 0]) @ truth
    outline = silhouette(problem.models[1], pose, problem.observation.camera)
    assert best_owner(outline, [i.mask for i in problem.instances]) == k
