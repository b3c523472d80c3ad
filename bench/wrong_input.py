"""Support planes and masks that are wrong on purpose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.problem import Instance
from verefine_viz.observation.segment import segment_cloud


def leaning(support: Support, axis_world: Float, angle_deg: float, down_m: float = 0.0) -> Support:
    """The plane turned about an axis through its world's origin, which lies below the objects, and lowered."""
    wrong = transform(axis_angle(axis_world, np.deg2rad(angle_deg)), [0, 0, down_m])
    return replace(support, T_world_cam=wrong @ support.T_world_cam)


def seen_through(mask: Mask, instance: Instance, observation: Observation, n_points: int) -> Instance:
    """The instance with another mask (H, W), and the cloud of at most ``n_points`` that it leads to."""
    cloud = segment_cloud(observation.depth_m, observation.camera, mask, n_points, 0)
    return replace(instance, mask=mask, points_cam=cloud)
