"""Initial poses with a known error, and frames with missing depth. Source: Sec. V-A, V-B (docs/methods.md 8.1)."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Mask
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply
from verefine_viz.core.problem import Instance, Problem
from verefine_viz.diagnosis.frame_ground_truth import FrameGroundTruth
from verefine_viz.observation.normals import estimate_normals
from verefine_viz.observation.observed_frame import segment_cloud
from verefine_viz.scenes.hypothesis_pool import perturbed

_RECTANGLE = (0.1, 0.35)
"""Smallest and largest sides of a rectangle, as a share of the sides of the object's bounding box."""


def disturbed(problem: Problem, n: int, rotation_deg: float, translation_mm: float, seed: int) -> Problem:
    """The frame with ``n`` initial poses per object, each off by exactly this error.

    Raises:
        InputError: no object has a ground-truth pose.
    """
    known = with_ground_truth(problem)
    instances = (_disturbed(i, problem, n, rotation_deg, translation_mm, seed) for i in known.instances)
    return replace(known, instances=tuple(instances))


def with_ground_truth(problem: Problem) -> Problem:
    """The frame with the objects that have ground truth.

    Raises:
        InputError: there is none.
    """
    known = [i.instance_id for i in problem.instances if i.T_cam_obj_gt is not None]
    if not known:
        raise InputError(f"frame {problem.frame} has no ground truth, expected scene_gt.json; a study compares with it")
    return problem.only(known)


def first_poses(problem: Problem, n: int) -> Problem:
    """The frame with at most ``n`` initial poses of each object."""
    return replace(problem, instances=tuple(replace(i, hypotheses=i.hypotheses[:n]) for i in problem.instances))


@lru_cache(maxsize=1)
def on_true_plane(problem: Problem) -> Problem:
    """The frame with the plane on which the objects really stand, by their ground-truth poses, as its support.

    Raises:
        InputError: no object has a ground-truth pose, or they rest on no visible plane.
    """
    known = with_ground_truth(problem)
    support = FrameGroundTruth(known).support
    if support is None:
        raise InputError(
            f"frame {problem.frame}: the ground-truth poses rest on no plane that is seen; an ablation needs it"
        )
    return replace(known, observation=replace(known.observation, support=support, support_note=""))


def _disturbed(
    i: Instance, problem: Problem, n: int, rotation_deg: float, translation_mm: float, seed: int
) -> Instance:
    assert i.T_cam_obj_gt is not None, "objects without ground truth are left out before"
    hypotheses = perturbed(i.T_cam_obj_gt, n, rotation_deg, translation_mm, _seeds(i, problem, seed))
    return replace(i, hypotheses=hypotheses)


def _seeds(i: Instance, problem: Problem, seed: int) -> tuple[int, ...]:
    """A seed for each object of each frame; it includes the object's id, as all built-in scenes are scene 0."""
    return seed, problem.scene_id, problem.im_id, i.instance_id, i.obj_id


def occluded(problem: Problem, share: float, seed: int) -> Problem:
    """Depth removed by rectangles around random pixels of each object, until ``share`` of its measured pixels is gone.

    Args:
        problem: the frame.
        share: in [0, 1); reached exactly for every object (the last rectangle is cut).
        seed: of the rectangles.
    """
    lost = np.zeros(problem.observation.camera.shape, dtype=bool)
    for i in problem.instances:
        rng = np.random.default_rng(_seeds(i, problem, seed))
        lost |= _rectangles(i.mask & (problem.observation.depth_m > 0), share, rng)
    return without_depth(problem, lost)


def _rectangles(measured: Mask, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    n_lost, lost = round(share * int(measured.sum())), np.zeros_like(measured)
    v, u = np.nonzero(measured)
    while (missing := n_lost - int(lost.sum())) > 0:
        sides = [max(1, round(float(np.ptp(x) + 1) * rng.uniform(*_RECTANGLE) / 2)) for x in (v, u)]
        left = np.flatnonzero(~lost[v, u])
        middle = rng.choice(left)
        near = (np.abs(v[left] - v[middle]) <= sides[0]) & (np.abs(u[left] - u[middle]) <= sides[1])
        hit = left[near][:missing]
        lost[v[hit], u[hit]] = True
    return lost


def without_top(problem: Problem, share: float) -> Problem:
    """Depth of each object removed above a height, chosen so that ``share`` of its measured pixels is gone.

    Stands for material that the sensor does not see (transparent, black).

    Raises:
        InputError: the frame has no support plane, from which heights are measured.
    """
    support = problem.observation.support
    if support is None:
        raise InputError(f"frame {problem.frame}: {problem.observation.support_note}; heights are measured from it")
    points = problem.observation.camera.back_project(problem.observation.depth_m)
    height_m = apply(support.T_world_cam, points.reshape(-1, 3)) @ support.normal_world
    height_m = height_m.reshape(problem.observation.camera.shape)
    lost = np.zeros_like(problem.observation.object_mask)
    for i in problem.instances:
        v, u = np.nonzero(i.mask & (problem.observation.depth_m > 0))
        highest = np.argsort(-height_m[v, u], kind="stable")[: round(share * len(v))]
        lost[v[highest], u[highest]] = True
    return without_depth(problem, lost)


def without_depth(problem: Problem, lost: Mask) -> Problem:
    """The frame with no measurement at ``lost`` (H, W). Masks, support plane and dependency order stay."""
    before = problem.observation
    depth_m = np.where(lost, np.float32(0), before.depth_m)
    observation = replace(before, depth_m=depth_m, normals_cam=estimate_normals(depth_m, before.camera))
    instances = tuple(
        replace(i, points_cam=segment_cloud(depth_m, before.camera, i.mask, len(i.points_cam), 0))
        for i in problem.instances
    )
    return replace(problem, observation=observation, instances=instances)
