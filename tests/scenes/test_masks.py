"""Masks: run lengths against pycocotools, silhouettes of poses, and whose mask a silhouette belongs to."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pycocotools import mask as coco

from tests.fakes import BOX_M, box_model, box_problem
from tests.scenes.bop_folder import run_lengths
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import transform
from verefine_viz.scenes.detections import RunLengths, decode_rle
from verefine_viz.scenes.segments import best_owner, overlap, silhouette

masks = hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=40))


@settings(max_examples=150, deadline=None)
@given(masks)
def test_both_encodings_are_inverted(mask: np.ndarray) -> None:
    shape = (mask.shape[0], mask.shape[1])
    as_list = RunLengths(shape, run_lengths(mask))
    code: Any = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
    as_string = RunLengths(shape, code["counts"].decode("ascii"))
    np.testing.assert_array_equal(decode_rle(as_list, shape), mask)
    np.testing.assert_array_equal(decode_rle(as_string, shape), mask)


@settings(max_examples=150, deadline=None)
@given(st.text(st.characters(min_codepoint=32, max_codepoint=200), max_size=12))
def test_any_other_string_is_refused_or_a_whole_mask(text: str) -> None:
    try:
        mask = decode_rle(RunLengths((4, 5), text), (4, 5))
    except ValueError:
        return
    # What is not refused was whole: it says something about every pixel.
    again: Any = coco.decode({"size": [4, 5], "counts": text.encode("ascii")})
    np.testing.assert_array_equal(mask, again.astype(bool))


CAMERA = Camera(np.array([[400.0, 0, 160], [0, 400, 120], [0, 0, 1]]), 320, 240)
small = hnp.arrays(np.bool_, (6, 7))


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
