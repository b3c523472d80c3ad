"""Measures a ``depth_net`` on shapes and views that no training sees."""

from __future__ import annotations

from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.learned.depth_crops import crops_at
from verefine_viz.learned.onnx_network import OnnxNetwork
from verefine_viz.refiners.depth_net import step_from
from verefine_viz.training.depth_net_samples import extent, held_out_views, nearest_equivalent
from verefine_viz.training.synthetic_views import SyntheticView

N_VIEWS = 150
STARTS = ((10.0, 0.1), (20.0, 0.2), (30.0, 0.3), (45.0, 0.4))
"""Turn [deg] and shift [radii] of the initial poses."""
STEPS = 6
"""Steps of the network."""


def measured(network: OnnxNetwork) -> list[dict[str, Any]]:
    """Mean distance of the shape's points from their true places for each of ``STARTS``, in % of the diameter."""
    views = held_out_views(N_VIEWS)
    rows = []
    for turn_deg, shift in STARTS:
        rng = np.random.default_rng(0)
        errors = np.array([_errors(view, start_at(view, turn_deg, shift, rng), network) for view in views])
        before, after = 100 * errors.T
        rows.append(
            {
                "start_deg": turn_deg,
                "start_shift_radii": shift,
                "n_views": N_VIEWS,
                "network_steps": STEPS,
                "median_start_percent_of_diameter": round(float(np.median(before)), 2),
                "median_percent_of_diameter": round(float(np.median(after)), 2),
                "share_below_10_percent": round(float((after < 10).mean()), 3),
            }
        )
    return rows


def start_at(view: SyntheticView, turn_deg: float, shift: float, rng: np.random.Generator) -> Float:
    """The ground truth (4, 4), turned [deg] and shifted [radii] in random directions."""
    turn = axis_angle(random_unit_vector(rng), np.deg2rad(turn_deg))
    moved = random_unit_vector(rng) * shift * view.shape.radius_m
    return transform(turn @ view.T_cam_obj[:3, :3], view.T_cam_obj[:3, 3] + moved)


def _errors(view: SyntheticView, T: Float, network: OnnxNetwork) -> tuple[float, float]:
    """Error of a pose before and after the network, as shares of the diameter."""
    Ts = T[None]
    for _ in range(STEPS):
        crops = crops_at(view.depth_m, view.mask, view.camera, view.shape.mesh, extent(view), Ts)
        Ts = step_from(Ts, crops, network, extent(view)).Ts_cam_obj
    return share_of_diameter(view, T), share_of_diameter(view, Ts[0])


def share_of_diameter(view: SyntheticView, T: Float) -> float:
    """Mean distance of the shape's points at a pose from their true places, as a share of the diameter."""
    wanted = nearest_equivalent(view, T)
    difference = view.shape.points @ (T[:3, :3] - wanted[:3, :3]).T + T[:3, 3] - wanted[:3, 3]
    return float(np.linalg.norm(difference, axis=1).mean() / (2 * view.shape.radius_m))
