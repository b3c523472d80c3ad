"""What an image allows: known answers, laws of its parts, and whether the truth is among the poses."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.failing_scenes import hidden_handle
from tests.made_up_frames import Thing, frame_of, model, near, session_of, standing
from tests.scenes.test_models import model_info
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.evaluation.allowed_poses import AllowedPoses, Extent, SixMotions
from verefine_viz.evaluation.allowed_search import allowed_poses
from verefine_viz.evaluation.pose_errors import add_s_mm
from verefine_viz.evaluation.seen_error import is_allowed, nearest_allowed
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo_layout import Viewpoint
from verefine_viz.scenes.demo_models import cuboid, lathe
from verefine_viz.scenes.meshes import Mesh
from verefine_viz.scenes.models import model_of_mesh, symmetry_transforms

CYLINDER = lathe([(0, 0), (0.035, 0), (0.035, 0.1), (0, 0.1)], 96)
BOX = cuboid((0.06, 0.09, 0.12), 0.12)
FRONTAL = Viewpoint(elevation_deg=3, distance_m=0.45)
VERIFIER = CpuVerifier(ScoreSettings(pixels="classes", tau_m=0.02))


def modelled(mesh: Mesh, name: str) -> ObjectModel:
    return model_of_mesh(mesh, 91, name, 1000, 0)


@cache
def target_of(name: str) -> Target:
    """A thing on a table at its ground truth, from which its scores are taken."""
    mesh, view = {"cylinder": (CYLINDER, None), "box": (BOX, None), "frontal box": (BOX, FRONTAL)}[name]
    one = modelled(mesh, name)
    T_world_obj = transform(np.eye(3), [0, 0, -float(one.vertices[:, 2].min())])
    problem = frame_of([Thing(one, T_world_obj)], np.random.default_rng(3), view)
    return problem.targets[0]


@cache
def allowed_of(name: str) -> AllowedPoses:
    target = target_of(name)
    return allowed_poses(VERIFIER, target, target.instance.T_cam_obj_gt)


def extent(allowed: AllowedPoses, kind: str, letter: str, frame: str = "object") -> Extent:
    return next(e for e in allowed.extents if (e.axis.kind, e.axis.letter, e.axis.frame) == (kind, letter, frame))


def test_a_cylinder_without_texture_is_undetermined_about_its_axis_and_determined_otherwise() -> None:
    allowed = allowed_of("cylinder")
    turn = extent(allowed, "turn", "z")
    assert (turn.low, turn.high) == (-180, 180)
    assert allowed.undetermined_deg == 180
    assert allowed.undetermined_mm < 2
    others = [
        e
        for e in allowed.extents
        if e.axis.kind == "turn" and abs(e.axis.direction_cam @ turn.axis.direction_cam) < 0.5
    ]
    assert len(others) == 4
    assert max(e.width for e in others) < 3
    assert allowed.least_certain.describe() == "turn about the vertical undetermined within ±180°"


def test_a_declared_axis_of_symmetry_is_undetermined_however_coarse_the_mesh() -> None:
    """Turned by less than the steps in which the symmetry is listed, a prism of twelve sides scores less."""
    twelve_sides = lathe([(0, 0), (0.035, 0), (0.035, 0.1), (0, 0.1)], 12)
    target = target_of("cylinder")
    info = {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]}
    declared = replace(modelled(twelve_sides, "prism"), symmetries=symmetry_transforms(model_info(info), "prism"))
    allowed = allowed_poses(VERIFIER, replace(target, model=declared), target.instance.T_cam_obj_gt)
    turn = extent(allowed, "turn", "z")
    assert (turn.low, turn.high) == (-180, 180)
    assert extent(allowed, "turn", "x").width < 10
    assert not allowed.alike  # A pose that is declared to be this one is no other.
    assert allowed.furthest is None


def test_a_box_with_three_faces_in_sight_is_determined_but_for_its_half_turns() -> None:
    target, allowed = target_of("box"), allowed_of("box")
    assert allowed.undetermined_mm < 2.5
    assert allowed.undetermined_deg < 3
    half_turns = [axis_angle(axis, np.pi) for axis in np.eye(3)]
    R = target.instance.T_cam_obj_gt[:3, :3]
    turns = [R.T @ one.T_cam_obj[:3, :3] for one in allowed.alike]
    assert len(turns) == 3
    for half in half_turns:
        assert min(np.linalg.norm(half - turn) for turn in turns) < 0.1


def test_the_missing_faces_of_a_box_seen_frontally_leave_its_depth_free() -> None:
    """One face in sight and no outline: where the mask ends nothing is observed, so that the box may slide and grow."""
    target = target_of("frontal box")
    # Only a part of the front face is in the mask, and nothing was measured around it.
    v, u = np.nonzero(target.instance.mask)
    part = np.zeros_like(target.instance.mask)
    middle_v, middle_u = int(np.median(v)), int(np.median(u))
    part[middle_v - 12 : middle_v + 12, middle_u - 12 : middle_u + 12] = True
    depth_m = np.where(part, target.observation.depth_m, np.float32(0))
    normals = estimate_normals(depth_m, target.observation.camera)
    seen = replace(target.observation, depth_m=depth_m, normals_cam=normals, object_mask=part)
    blind = Target(seen, replace(target.instance, mask=part), target.model)
    allowed, whole = allowed_poses(VERIFIER, blind, target.instance.T_cam_obj_gt), allowed_of("frontal box")
    # Across the face the box can slide; along the line of sight it cannot.
    assert extent(allowed, "shift", "x").width > 1.5 * extent(whole, "shift", "x").width
    assert extent(allowed, "shift", "x").width > 10
    assert extent(allowed, "shift", "y").width < 2
    assert extent(allowed, "turn", "z").width < 8


@pytest.mark.parametrize("seed", range(3))
def test_with_a_hidden_handle_the_truth_is_among_the_poses_and_the_answer_among_those_of_the_truth(seed: int) -> None:
    broken = hidden_handle(np.random.default_rng(seed))
    (target,), verifier = broken.problem.targets, broken.toolbox.verifier
    T_gt = target.instance.T_cam_obj_gt
    run = broken.toolbox.run(broken.problem)
    (answer,) = run.finish().best
    diameter_mm = 1e3 * target.model.diameter_m
    assert add_s_mm(target.model, answer.T_cam_obj, T_gt) > 0.1 * diameter_mm
    allowed = allowed_poses(verifier, target, answer.T_cam_obj)
    assert is_allowed(allowed, target.model, T_gt)
    assert nearest_allowed(allowed, target.model, T_gt)[1] < 0.03 * diameter_mm
    of_gt = allowed_poses(verifier, target, T_gt)
    assert nearest_allowed(of_gt, target.model, answer.T_cam_obj)[1] < 0.1 * diameter_mm
    assert extent(allowed, "turn", "z", "table").width > 25
    assert allowed.furthest is not None


def test_answers_on_made_up_frames_are_as_far_from_the_truth_as_is_stated_and_no_handle_in_sight_is_wide() -> None:
    apart, widths = [], []
    for seed in range(8):
        rng = np.random.default_rng(200 + seed)
        one = model(["mug", "jug", "carton", "duck"][seed % 4])
        T = standing(one, rng)
        problem = frame_of([Thing(one, T, near(T, rng, 1, 6, 6))], rng)
        toolbox = Toolbox(session_of("sir", 3, method={"refiner": "icp"}, physics={"enabled": False}))
        (target,), (answer,) = problem.targets, toolbox.run(problem).finish().best
        allowed = allowed_poses(toolbox.verifier, target, answer.T_cam_obj)
        small = allowed.small
        motion = small.six.motion_to(target.instance.T_cam_obj_gt, answer.T_cam_obj)
        apart.append((motion - small.offset) / np.sqrt(np.diag(small.covariance)))
        widths.append(allowed.undetermined_deg)
    # Normal numbers of variance 1, six for each of eight answers.
    assert np.mean(np.abs(apart) < 2) >= 0.9
    assert 0.4 < np.sqrt(np.mean(np.square(apart))) < 1.6
    assert np.median(widths) < 6


@given(st.lists(st.floats(-20, 20), min_size=6, max_size=6), st.integers(0, 1000))
def test_a_motion_leads_where_it_is_measured_from(motion: list[float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    directions = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    T = transform(axis_angle([0.0, 0.6, 0.8], rng.uniform(0, 3)), rng.uniform(-0.3, 0.3, 3))
    six = SixMotions(T, rng.uniform(-0.3, 0.3, 3), directions, np.ones(6))
    there = six.moved(np.array(motion))
    np.testing.assert_allclose(six.motion_to(there, T), motion, atol=1e-6)


def test_what_is_known_about_one_axis_is_that_of_the_covariance_along_it() -> None:
    allowed = allowed_of("box")
    small = allowed.small
    draws = np.random.default_rng(0).multivariate_normal(small.offset, small.covariance, 20_000)
    for one in allowed.extents:
        if len(one.offsets):
            continue  # Followed further than small motions go.
        part = draws[:, :3] if one.axis.kind == "shift" else draws[:, 3:]
        along = part @ (small.six.directions_cam @ one.axis.direction_cam)
        within = (along >= one.low) & (along <= one.high)
        assert within.mean() > 0.94


def test_the_same_question_has_the_same_answer_bit_for_bit() -> None:
    target, one = target_of("box"), allowed_of("box")
    two = allowed_poses(CpuVerifier(VERIFIER.settings), target, target.instance.T_cam_obj_gt)
    assert [(e.low, e.high) for e in one.extents] == [(e.low, e.high) for e in two.extents]
    assert [a.tobytes() for a in one.anchors] == [b.tobytes() for b in two.anchors]
    assert one.small.covariance.tobytes() == two.small.covariance.tobytes()
