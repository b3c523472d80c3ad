"""Frames (320×240, with colour and sensor noise) of things that stand on a table, under a camera that moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.made_up_frames import CAMERA, SETTINGS, Z, model, moved, standing
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import angle_between, axis_angle, inverse, random_unit_vector, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.observation.observed_frame import observe
from verefine_viz.scenes.demo_layout import Viewpoint, take_picture
from verefine_viz.scenes.labels import Label
from verefine_viz.scenes.sensor import sense

STEP_M, STEP_DEG = 0.03, 4.0
"""Most that the camera moves between two frames."""
LAYOUT = (("cereal", 0.02, 0.10, 20.0), ("bottle", -0.09, 0.0, 0.0), ("duck", 0.07, -0.05, -50.0))
"""Model, place [m] and heading [deg]."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame with what is true of it."""

    observation: Observation
    placed: tuple[Placed, ...]
    """The objects where they are."""
    T_world_cam: Float


def things(layout: Sequence[tuple[str, float, float, float]] = LAYOUT) -> list[tuple[ObjectModel, Float]]:
    """Models with their T_world_obj."""
    upright = np.random.default_rng(0)
    return [
        (model(name), moved(standing(model(name), upright, 0.0, yaw_deg), Z, 0.0, (1e3 * x, 1e3 * y, 0)))
        for name, x, y, yaw_deg in layout
    ]


def path(n: int, seed: int = 0) -> list[Float]:
    """T_world_cam of a camera that goes around the table in full steps, and trembles."""
    rng, Ts = np.random.default_rng(seed), []
    for k in range(n):
        # 1.8° on a circle of 0.7 m are 22 mm.
        T = Viewpoint(-110 + 1.8 * k, 40 + 3 * np.sin(0.3 * k), 0.72).T_world_cam
        T = T @ transform(axis_angle(random_unit_vector(rng), np.radians(0.5)), 0.002 * random_unit_vector(rng))
        if Ts:
            assert np.linalg.norm(T[:3, 3] - Ts[-1][:3, 3]) <= STEP_M
            assert np.degrees(angle_between(Ts[-1][:3, :3], T[:3, :3])) <= STEP_DEG
        Ts.append(T)
    return Ts


def shot(
    there: Sequence[tuple[ObjectModel, Float]],
    T_world_cam: Float,
    seed: int,
    hidden: Mask | None = None,
    with_colour: bool = True,
) -> Shot:
    """A picture of things; something 0.3 m away stands before the pixels (H, W) that are hidden."""
    placed = tuple(Placed(k, m, inverse(T_world_cam) @ T) for k, (m, T) in enumerate(there))
    seen = take_picture(placed, T_world_cam, CAMERA)
    depth_m = sense(seen.depth_m, seen.normals_cam, CAMERA, seed)
    rgb = np.clip(seen.rgb + np.random.default_rng(seed).normal(0, 3, seen.rgb.shape), 0, 255).astype(np.uint8)
    if hidden is not None:
        depth_m, rgb = np.where(hidden, np.float32(0.3), depth_m), np.where(hidden[..., None], np.uint8(90), rgb)
    T = T_world_cam
    observation = observe(CAMERA, depth_m, rgb if with_colour else None, [], SETTINGS, T[:3, :3], T)
    return Shot(observation, placed, T)


def without_camera_pose(seen: Observation) -> Observation:
    """The frame of a data set that does not state where its camera is."""
    return replace(seen, T_map_cam=None)


def true_labels(shot: Shot, off_mm: float = 1.0, seed: int = 0) -> tuple[Label, ...]:
    """Accepted labels that are off by so much in any direction."""
    rng = np.random.default_rng(seed)
    labels = []
    for one in shot.placed:
        T = moved(one.T_cam_obj, Z, 0.0, off_mm * random_unit_vector(rng))
        pose = tuple(T.ravel().tolist())
        labels.append(Label(one.instance_id, one.model.obj_id, one.model.name, pose, "green", state="accepted"))
    return tuple(labels)
