"""What a scene leaves unexplained, against pictures drawn by hand and by another renderer."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import BOX_M, box_model, box_problem
from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.problem import Placed, Problem
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.explained import TABLE_M, ExplainedPixels, without_table

EXPLAINED_M = 0.010


@pytest.fixture(scope="module")
def renderer(tmp_path_factory: pytest.TempPathFactory) -> ExplainedPixels:
    return ExplainedPixels(EXPLAINED_M, ScoreSettings(), tmp_path_factory.mktemp("meshes"))


def true_scene(problem: Problem) -> tuple[Placed, ...]:
    found = []
    for i in problem.instances:
        found.append(Placed(i.instance_id, problem.models[i.obj_id], i.T_cam_obj_gt))
    return tuple(found)


def bare(problem: Problem) -> Observation:
    """The frame with nothing measured but the boxes' fronts: no table, no support."""
    o = problem.observation
    return replace(o, depth_m=np.where(o.object_mask, o.depth_m, 0), support=None)


def test_the_true_scene_explains_every_pixel(renderer: ExplainedPixels) -> None:
    problem = box_problem(1, 2)
    scene = true_scene(problem)
    observed = renderer.depth_m(problem.observation, scene)  # perfect sensor
    seen = replace(problem.observation, depth_m=observed, support=None, object_mask=observed > 0)
    assert renderer.unexplained_px(seen, scene) == 0
    assert (
        renderer.unexplained_px(seen, scene[:1]) == (observed > 0).sum() - (renderer.depth_m(seen, scene[:1]) > 0).sum()
    )
    assert renderer.unexplained_px(seen, ()) == (observed > 0).sum()


def test_a_pixel_is_explained_within_ten_millimetres(renderer: ExplainedPixels) -> None:
    problem = box_problem(1)
    seen = bare(problem)
    (box,) = true_scene(problem)
    for shift_m, explains in ((0.0, True), (0.009, True), (-0.009, True), (0.012, False), (-0.012, False)):
        moved = replace(box, T_cam_obj=transform(np.eye(3), [0, 0, shift_m]) @ box.T_cam_obj)
        front = problem.instances[0].mask & (renderer.depth_m(seen, [moved]) > 0)
        assert front.sum() > 50, (shift_m, explains)
        assert (not renderer.unexplained(seen, [moved])[front].any()) == explains, (shift_m, explains)


def test_what_is_drawn_beside_the_objects_counts_too(renderer: ExplainedPixels) -> None:
    seen = bare(box_problem(1))
    nothing = replace(seen, depth_m=np.zeros_like(seen.depth_m))
    scene = true_scene(box_problem(1))
    drawn = renderer.depth_m(seen, scene) > 0
    assert renderer.unexplained_px(nothing, scene) == drawn.sum()
    assert renderer.unexplained_px(nothing, ()) == 0


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20)
def test_the_count_is_that_of_the_picture_and_inclusion_and_exclusion_agree(
    renderer: ExplainedPixels, seed: int
) -> None:
    """docs/methods.md 3.3: observed + drawn − both, less those of both that agree."""
    rng = np.random.default_rng(seed)
    problem = box_problem(1, 2)
    scene = [
        replace(
            p,
            T_cam_obj=p.T_cam_obj
            @ transform(axis_angle(random_unit_vector(rng), rng.uniform(0, 1)), rng.normal(0, 0.02, 3)),
        )
        for p in true_scene(problem)
    ]
    o = problem.observation
    observed, drawn = renderer.observed_m(o), renderer.depth_m(o, scene)
    both = (observed > 0) & (drawn > 0)
    agree = both & (np.abs(observed.astype(np.float64) - drawn) <= EXPLAINED_M)
    expected = (observed > 0).sum() + (drawn > 0).sum() - both.sum() - agree.sum()
    assert renderer.unexplained_px(o, scene) == pytest.approx(expected, abs=1)  # one rounding of 1/z
    assert renderer.unexplained_px(o, scene) == renderer.unexplained_px(o, scene[::-1])
    assert renderer.unexplained(o, scene).sum() == pytest.approx(expected, abs=1)


def test_draws_what_the_verifier_draws(renderer: ExplainedPixels, tmp_path: Path) -> None:
    problem = box_problem(2)
    T = problem.instances[0].hypotheses[1].T_cam_obj
    theirs = CpuVerifier(ScoreSettings(), tmp_path).maps(problem.targets[0], T).rendered_m
    assert np.array_equal(renderer.depth_m(problem.observation, [Placed(0, box_model(), T)]), theirs)


def test_nearer_objects_hide_farther_ones(renderer: ExplainedPixels) -> None:
    o = box_problem(1).observation
    near, far = (Placed(k, box_model(), transform(np.eye(3), [0, 0, z])) for k, z in enumerate((0.5, 0.8)))
    both = renderer.depth_m(o, [near, far])
    covered = renderer.depth_m(o, [near]) > 0
    assert np.array_equal(both[covered], renderer.depth_m(o, [near])[covered])
    assert np.array_equal(both[~covered], renderer.depth_m(o, [far])[~covered])


def test_only_what_is_five_millimetres_above_the_plane_is_left() -> None:
    """A camera that looks straight down on a plane at 0.8 m, and a step on it."""
    seen, R = box_problem(1).observation, np.diag([1.0, -1, -1])
    rays = seen.camera.back_project(np.ones(seen.camera.shape))
    for height_m, slope in itertools.product((-0.2, -0.004, 0.0, 0.004, 0.006, 0.05), (0.0, 0.1)):
        normal = np.array([np.sin(slope), 0, np.cos(slope)])
        support = Support(transform(R, [0, 0, 0.8]), normal, "plane", 1.0)
        # Points of each ray on the plane n·(R p + t) = height.
        depth_m = (height_m - normal @ [0, 0, 0.8]) / (rays @ (R.T @ normal))
        o = replace(seen, depth_m=depth_m.astype(np.float32), support=support)
        left = without_table(o)
        assert np.array_equal(left, o.depth_m if height_m > TABLE_M else 0 * o.depth_m), (height_m, slope)


def test_the_table_of_a_frame_goes_and_its_boxes_stay() -> None:
    problem = box_problem(1, 2)
    left = without_table(problem.observation)
    mask = problem.observation.object_mask
    assert not left[~mask].any()
    above = mask & (left > 0)
    assert above.sum() > (1 - 2 * TABLE_M / BOX_M[1]) * mask.sum()
    assert np.array_equal(left[above], problem.observation.depth_m[above])


def test_without_a_plane_masks_show_objects_and_odd_depth_was_not_measured() -> None:
    o = replace(box_problem(1).observation, support=None)
    assert np.array_equal(without_table(o), np.where(o.object_mask, o.depth_m, 0))
    o = box_problem(1).observation
    broken = o.depth_m.copy()
    broken[::7], broken[1::7], broken[2::7] = np.nan, np.inf, -1.0
    left = without_table(replace(o, depth_m=broken))
    assert np.isfinite(left).all()
    assert (left >= 0).all()
    assert not left[::7].any()


def test_a_scene_outside_of_the_image_explains_nothing(renderer: ExplainedPixels) -> None:
    seen = bare(box_problem(1))
    behind = Placed(0, box_model(), transform(np.eye(3), [0, 0, -1.0]))
    lost = Placed(1, box_model(), np.where(np.eye(4) > 0, np.nan, 0.0))
    assert renderer.unexplained_px(seen, [behind, lost]) == (seen.depth_m > 0).sum()
