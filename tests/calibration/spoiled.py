"""Frames with one thing wrong, for tests of the checks and of what puts data right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tests.calibration.right_variants import estimated, off
from tests.calibration.sizes import moved, scene, transposed, with_camera, with_focal, with_instances, with_models
from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.data_remedies import TO_OPENGL
from verefine_viz.core.geometry import axis_angle, inverse, transform
from verefine_viz.core.problem import Problem

CLUTTER = scene("clutter", "0/0")
Z_UP = transform(axis_angle(np.array([1.0, 0.0, 0.0]), np.pi / 2), np.zeros(3))


def with_depth(problem: Problem, factor: float | Float) -> Problem:
    """Depth multiplied, by one number or pixel by pixel."""
    seen = problem.observation
    return replace(problem, observation=replace(seen, depth_m=(seen.depth_m * factor).astype(np.float32)))


def displaced(array: NDArray, right: int, down: int = 0) -> NDArray:
    """An image that is moved by some pixels."""
    return np.ascontiguousarray(np.roll(array, (down, right), (0, 1)))


def with_depth_beside(problem: Problem, right: int) -> Problem:
    """Depth moved by some pixels."""
    seen = problem.observation
    return replace(problem, observation=replace(seen, depth_m=displaced(seen.depth_m, right)))


def with_rgb(problem: Problem, rgb: NDArray[np.uint8] | None) -> Problem:
    return replace(problem, observation=replace(problem.observation, rgb=rgb))


def other_size(problem: Problem, factor: float = 0.5) -> Problem:
    """The camera of images of another size."""
    right = problem.observation.camera
    return with_camera(problem, Camera(np.diag([factor, factor, 1]) @ right.K, right.width, right.height))


def other_focal(problem: Problem, factor: float) -> Problem:
    return with_camera(problem, with_focal(problem.observation.camera, factor))


def blind(change: Callable[[Float], Float] = lambda T: T, problem: Problem = CLUTTER) -> Problem:
    """The frame without ground truth, with poses of an estimator that are 3 mm and 3° off."""
    disturb = off(np.random.default_rng(0), 3, 3)
    return estimated(problem, lambda T: change(disturb(T)))


def inverted_masks(problem: Problem) -> Problem:
    return with_instances(problem, lambda i: replace(i, mask=~i.mask))


SPOILED: dict[str, Callable[[], Problem]] = {
    **{f"depth × {f:g}": (lambda f=f: with_depth(blind(), f)) for f in (10.0, 4.0, 5.0, 39.37, 1.25, 0.8, 0.001)},
    "depth beside": lambda: with_depth_beside(blind(), 25),
    "models × 0.1": lambda: with_models(blind(), 0.1),
    **{f"translations × {f:g}": (lambda f=f: blind(moved(f))) for f in (1000.0, 10.0, 0.001)},
    "everything in metres": lambda: with_depth(with_models(blind(moved(0.001)), 0.001), 0.001),
    "inverse": lambda: blind(inverse),
    "OpenGL": lambda: blind(lambda T: TO_OPENGL @ T),
    "transposed": lambda: blind(transposed),
    "inverted masks": lambda: inverted_masks(blind()),
    "K of another camera": lambda: other_focal(blind(), 0.63),
    "K of another size": lambda: other_size(blind()),
    "ground truth and depth × 10": lambda: with_depth(CLUTTER, 10.0),
    "ground truth and depth × 0.1": lambda: with_depth(CLUTTER, 0.1),
    "ground truth and depth beside": lambda: with_depth_beside(CLUTTER, -21),
    "ground truth and models × 10": lambda: with_models(CLUTTER, 10.0),
    "ground truth and another K": lambda: other_focal(CLUTTER, 0.8),
    "ground truth and inverted masks": lambda: inverted_masks(CLUTTER),
}
"""Frames that one remedy puts right."""
IN_TRUTH: dict[str, Callable[[Float], Float]] = {
    **{f"translations × {f:g}": moved(f) for f in (10.0, 0.1, 0.001)},
    "inverse": inverse,
    "OpenGL": lambda T: TO_OPENGL @ T,
    "transposed": transposed,
    "y up": lambda T: T @ Z_UP,
}
"""What can be wrong with poses of ground truth."""
