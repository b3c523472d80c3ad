"""The axes along and about which an object is moved: those of the table and those of the model."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.problem import Target
from verefine_viz.evaluation.allowed_poses import Axis, Frame, Letter

LETTERS: tuple[Letter, ...] = ("x", "y", "z")
AXIS_WORDS = (
    "shift right", "shift away", "shift up", "tilt to the camera", "tilt sideways", "turn about the vertical",
    "shift along its x", "shift along its y", "shift along its z",
    "turn about its x", "turn about its y", "turn about its z",
)  # fmt: skip
"""Three shifts and three turns of the table, then of the model; "right" and "away" are the camera's."""
N_AXES = len(AXIS_WORDS)
ROBUST_M = 0.002
"""A point that a turn moves off its surface by more than this counts less for where the turn's axis is [m]."""


def axes_of(target: Target, T_cam_obj: Float) -> tuple[Axis, ...]:
    """The twelve axes of a pose: shifts and turns of the table (of the camera where no table is known), then of the
    model.
    """
    support, words = target.observation.support, AXIS_WORDS
    if support is not None:
        up = support.T_world_cam[:3, :3].T @ support.normal_world
        # A camera on its side has its x axis along the vertical.
        aside = np.array([1.0, 0, 0] if abs(up[0]) < 0.9 else [0, 1.0, 0])
        right = aside - (aside @ up) * up
        right /= np.linalg.norm(right)
    else:
        up, right = np.array([0.0, -1, 0]), np.array([1.0, 0, 0])
        words = tuple(name.replace("the vertical", "the camera's vertical") for name in words)
    directions = right, np.cross(up, right), up, *T_cam_obj[:3, :3].T
    surface = _seen_surface(target, T_cam_obj)
    middle = apply(T_cam_obj, target.model.middle_m[None])[0]
    axes: list[Axis] = []
    for k, name in enumerate(words):
        frame: Frame = "table" if k < N_AXES // 2 else "object"
        is_turn = k % 6 >= 3
        direction = directions[k % 3 + (3 if frame == "object" else 0)]
        pivot = _pivot(surface, middle, direction) if is_turn else T_cam_obj[:3, 3]
        axes.append(Axis("turn" if is_turn else "shift", frame, LETTERS[k % 3], direction, pivot, name))
    return tuple(axes)


def _seen_surface(target: Target, T_cam_obj: Float) -> tuple[Float, Float]:
    """Points and normals of the model that face the camera (n, 3) each, camera frame [m]."""
    points, normals = apply(T_cam_obj, target.model.points), target.model.point_normals @ T_cam_obj[:3, :3].T
    faces = np.einsum("ij,ij->i", points, normals) < 0
    return (points[faces], normals[faces]) if faces.any() else (points, normals)


def _pivot(surface: tuple[Float, Float], middle: Float, axis: Float) -> Float:
    """The point through which a turn about ``axis`` moves the seen surface least off itself: a mug's turn is about the
    axis of its body, wherever its handle puts the middle of the model.
    """
    points, normals = surface
    x = points - middle
    # A turn moves x off its surface by n · (axis × (x − c)) = n · (axis × x) − c · (n × axis).
    off, lever = np.einsum("ij,ij->i", normals, np.cross(axis, x)), np.cross(normals, axis)
    weight, c = np.ones(len(points)), np.zeros(3)
    for _ in range(8):
        A = (lever * weight[:, None]).T @ lever
        # A little pull towards the middle, and the place along the axis does not matter.
        A += len(points) * (0.001 * np.eye(3) + np.outer(axis, axis))
        c = np.linalg.solve(A, lever.T @ (weight * off))
        weight = 1.0 / (1.0 + ((off - lever @ c) / ROBUST_M) ** 2)
    return middle + c
