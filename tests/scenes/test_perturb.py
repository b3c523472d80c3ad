"""Perturbed ground truth has exactly the error that was asked for, in every direction alike."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.scenes.bop_folder import make
from verefine_viz.core.geometry import angle_between, axis_angle, rotation_vector, transform
from verefine_viz.core.settings import HypothesesSettings
from verefine_viz.scenes.hypothesis_pool import perturbed

T_GT = transform(axis_angle([1, 2, 3], 0.7), [0.1, -0.2, 0.9])


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 179), st.floats(0, 200), st.integers(0, 2**31))
def test_the_error_is_exactly_as_asked(rotation_deg: float, translation_mm: float, seed: int) -> None:
    for h in perturbed(T_GT, 3, rotation_deg, translation_mm, seed):
        turned = angle_between(T_GT[:3, :3], h.T_cam_obj[:3, :3])
        assert np.degrees(turned) == pytest.approx(rotation_deg, abs=1e-6)
        assert np.linalg.norm(h.T_cam_obj[:3, 3] - T_GT[:3, 3]) * 1e3 == pytest.approx(translation_mm, abs=1e-9)


def test_axes_and_directions_are_uniform() -> None:
    poses = [h.T_cam_obj for h in perturbed(T_GT, 3000, 30, 30, 1)]
    axes = np.array([rotation_vector(T[:3, :3] @ T_GT[:3, :3].T) for T in poses]) / np.radians(30)
    directions = np.array([T[:3, 3] - T_GT[:3, 3] for T in poses]) / 0.030
    for vectors in (axes, directions):
        # Mean 0 and variance 1/3 along every axis; 5 standard errors at n = 3000.
        np.testing.assert_allclose(vectors.mean(axis=0), 0, atol=5 * np.sqrt(1 / 3 / 3000))
        np.testing.assert_allclose(vectors.T @ vectors / 3000, np.eye(3) / 3, atol=0.03)
    # The axis tells nothing about the direction.
    np.testing.assert_allclose(axes.T @ directions / 3000, 0, atol=5 / 3 / np.sqrt(3000))


def test_it_depends_on_the_seed_only_and_grows_at_the_end() -> None:
    short, long = perturbed(T_GT, 2, 30, 30, (1, 2, 3)), perturbed(T_GT, 5, 30, 30, (1, 2, 3))
    other = perturbed(T_GT, 2, 30, 30, (1, 2, 4))
    assert [h.T_cam_obj.tobytes() for h in short] == [h.T_cam_obj.tobytes() for h in long[:2]]
    assert short[0].T_cam_obj.tobytes() != other[0].T_cam_obj.tobytes()
    assert [h.source for h in short] == ["perturbed 30° 30 mm #1", "perturbed 30° 30 mm #2"]


def test_frames_are_disturbed_independently_of_each_other(tmp_path) -> None:
    made = make(tmp_path, targets=False)
    made.edit("scene_camera.json", lambda c: c.update({"4": c["3"]}))
    h = HypothesesSettings(max_per_object=2)
    alone = made.open(h, frames=("7/3",)).problem("7/3")
    source = made.open(h)
    assert source.frames == ("7/3", "7/4")
    among = source.problem("7/3")
    for a, b in zip(alone.instances, among.instances, strict=True):
        assert [x.T_cam_obj.tobytes() for x in a.hypotheses] == [x.T_cam_obj.tobytes() for x in b.hypotheses]
    errors = {x.T_cam_obj[:3, :3].tobytes() for i in among.instances for x in i.hypotheses}
    assert len(errors) == 6
