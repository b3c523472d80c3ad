"""Poses that no object can have, made from ground truth, and which are called impossible; for tests and bench."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.finding import Finding
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import HypothesesSettings, PhysicsSettings, SceneSettings
from verefine_viz.diagnosis.impossible import impossible_answers
from verefine_viz.diagnosis.measured_heights import MeasuredHeights, base_of, heights_in_common
from verefine_viz.physics.plausibility import plausibility
from verefine_viz.physics.proximity import Surface, Surfaces
from verefine_viz.scenes.demo import demo_frames, demo_names, demo_problem
from verefine_viz.scenes.source import open_scene

SUNK_MM, RAISED_MM = -25.0, 30.0
NESTED_M = 0.03
"""Of objects whose middles are nearer one may lie in the other, as in a bowl [m]."""
Poses = list[Float | None]


def real_frames(data: Path) -> Iterator[Problem]:
    """Frames with ground truth."""
    for folder in ("ycbv", "lm"):
        if (data / folder).is_dir():
            scene = SceneSettings(source="bop", dataset=str((data / folder).resolve()))
            source = open_scene(scene, HypothesesSettings())
            yield from map(source.problem, source.frames)


def built_in_frames() -> Iterator[Problem]:
    """All frames of the built-in scenes."""
    for name in demo_names():
        for frame in demo_frames(name):
            yield demo_problem(name, SceneSettings(), HypothesesSettings(), frame)


def named(problem: Problem, poses: Poses, surface_of: Callable[[ObjectModel], Surface]) -> dict[int, Finding]:
    """Instances whose poses (4, 4) are called impossible where no ground truth is known, and why."""
    blind = replace(problem, instances=tuple(replace(i, T_cam_obj_gt=None) for i in problem.instances))
    check = partial(plausibility, settings=PhysicsSettings(collider="hull"), surface_of=surface_of)
    return impossible_answers(blind, poses, check, heights_of(blind, poses))


def heights_of(problem: Problem, poses: Poses) -> MeasuredHeights | None:
    """What depth measures of heights, as if all poses fitted."""
    support = problem.observation.support
    assert support is not None
    pairs = [(t.model, T) for t, T in zip(problem.targets, poses, strict=True) if T is not None]
    return heights_in_common([base for m, T in pairs if (base := base_of(m, T, support)) is not None])


def truth_of(problem: Problem) -> Poses:
    """Ground truth of each target."""
    return [target.instance.T_cam_obj_gt for target in problem.targets]


def lifted(T_cam_obj: Float, support: Support, mm: float) -> Float:
    """The pose so much further from the support plane."""
    T = T_cam_obj.copy()
    T[:3, 3] += 1e-3 * mm * (support.T_world_cam[:3, :3].T @ support.normal_world)
    return T


def wrong_poses(problem: Problem, k: int) -> Iterator[tuple[str, Float]]:
    """Poses that target ``k`` cannot have among the others."""
    poses, support = truth_of(problem), problem.observation.support
    own = poses[k]
    if own is None or support is None:
        return
    yield "sunk", lifted(own, support, SUNK_MM)
    yield "floating", lifted(own, support, RAISED_MM)
    centres = [
        (target.model.vertices @ T[:3, :3].T + T[:3, 3]).mean(axis=0)
        for target, T in zip(problem.targets, poses, strict=True)
        if T is not None
    ]
    if len(centres) == len(poses) > 1:
        away_m = np.linalg.norm(np.array(centres) - centres[k], axis=1)
        away_m[away_m < NESTED_M] = np.inf
        if not np.isfinite(away_m).any():
            return
        inside = own.copy()
        inside[:3, 3] += centres[int(np.argmin(away_m))] - centres[k]
        yield "in a neighbour", inside


def table(frames: Iterable[Problem]) -> dict[str, list[tuple[str, bool]]]:
    """By what was done to it, objects and whether their poses are called impossible."""
    surfaces, rows = Surfaces(), dict[str, list[tuple[str, bool]]]()
    for problem in frames:
        truth = truth_of(problem)
        if problem.observation.support is None:
            continue
        at_truth = named(problem, truth, surfaces)
        for k, target in enumerate(problem.targets):
            own, label = target.instance.instance_id, f"{problem.title}, {problem.frame} {target.model.name}"
            if truth[k] is None:
                continue
            why = f": {at_truth[own].text} {_where(problem, truth[k])}" if own in at_truth else ""
            rows.setdefault("ground truth", []).append((label + why, own in at_truth))
            for what, T in wrong_poses(problem, k):
                is_named = own in named(problem, [*truth[:k], T, *truth[k + 1 :]], surfaces)
                rows.setdefault(what, []).append((label, is_named))
    return rows


def _where(problem: Problem, T_cam_obj: Float | None) -> str:
    """A pose and the camera's above the support plane, so that a failure says which of them is off."""
    support = problem.observation.support
    assert support is not None
    assert T_cam_obj is not None
    return f"T_world_obj {(support.T_world_cam @ T_cam_obj).tolist()}, T_world_cam {support.T_world_cam.tolist()}"
