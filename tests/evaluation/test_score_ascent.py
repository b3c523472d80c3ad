"""The highest score near a pose."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made_up_frames import Thing, frame_of, model, moved, standing
from verefine_viz.core.geometry import random_unit_vector
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.evaluation.score_ascent import highest_near
from verefine_viz.run.session_file import resolve
from verefine_viz.run.toolbox import Toolbox


@cache
def verifier() -> Verifier:
    return Toolbox(resolve({"physics": {"enabled": False}})).verifier


@cache
def problem(name: str) -> Problem:
    rng = np.random.default_rng(4)
    m = model(name)
    return frame_of([Thing(m, standing(m, rng, yaw_deg=30))], rng)


def target(name: str) -> Target:
    return problem(name).targets[0]


@pytest.mark.parametrize("name", ["duck", "carton"])
@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000))
def test_it_comes_back_to_ground_truth_from_nearby_and_never_scores_less(name: str, seed: int) -> None:
    rng, t = np.random.default_rng(seed), target(name)
    T_gt = t.instance.T_cam_obj_gt
    start = moved(T_gt, random_unit_vector(rng), 0.5, 1.0 * random_unit_vector(rng))
    T, score = highest_near(verifier(), t, start)
    before, at_gt = (verifier().score(t, pose[None])[0].score for pose in (start, T_gt))
    assert score.score >= before
    assert score.score >= at_gt - 0.25 * max(at_gt - before, 0.002)
    assert score.score == verifier().score(t, T[None])[0].score
    assert T[:3, :3] @ T[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
    assert add_s_mm(t.model, T, T_gt) < 4


def test_the_same_arguments_give_the_same_bits() -> None:
    t = target("duck")
    T_gt = t.instance.T_cam_obj_gt
    (T_one, one), (T_two, two) = (highest_near(verifier(), t, T_gt) for _ in range(2))
    assert np.array_equal(T_one, T_two)
    assert one.score == two.score
