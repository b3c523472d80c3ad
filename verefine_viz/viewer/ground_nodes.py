"""What the objects stand on, in 3D: the plane with its grid, and the direction of gravity."""

from __future__ import annotations

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, transform
from verefine_viz.viewer.cloud import measured_points
from verefine_viz.viewer.stage_nodes import place
from verefine_viz.viewer.view import View


class GroundNodes:
    """Made once per frame; afterwards visibility changes."""

    def __init__(self, scene: viser.SceneApi, view: View, T_world_cam: Float) -> None:
        support, points = view.problem.observation.support, measured_points(view.problem)
        centre = apply(T_world_cam, points.mean(axis=0)[None])[0]
        up = support.normal_world if support else np.array([0.0, 0, 1])
        across = np.cross(up, [0.0, 1, 0]) if abs(up[1]) < 0.9 else np.cross(up, [1.0, 0, 0])
        across /= np.linalg.norm(across)
        R_world_plane = np.stack([across, np.cross(up, across), up], axis=-1)
        foot = centre - (centre @ up) * up
        T = transform(R_world_plane, foot)
        side = 0.8
        self._grid = scene.add_grid(
            "/world/grid", side, side, cell_size=0.05, section_size=0.2, cell_color=(170, 170, 170),
            section_color=(120, 120, 120), cell_thickness=0.5, section_thickness=1.0, shadow_opacity=0.0,
            plane_color=(120, 150, 190), plane_opacity=0.22,
        )  # fmt: skip
        place(self._grid, T)
        radius = float(np.percentile(np.linalg.norm(points - points.mean(axis=0), axis=1), 90))
        away = apply(T_world_cam, np.zeros((1, 3)))[0] - centre
        beside = np.cross(away, [0.0, 0.0, 1.0])
        beside *= (1.6 * radius + 0.03) / max(float(np.linalg.norm(beside)), 1e-9)
        tail = foot + np.array([0.0, 0.0, 0.16]) - beside
        # Lines, since they keep their colour in the shade.
        tip = tail - [0, 0, 0.10]
        back = np.array([[0.008, 0, 0.02], [-0.008, 0, 0.02], [0, 0.008, 0.02], [0, -0.008, 0.02]])
        barbs = tip + back
        strokes = np.array([(tail, tip), *((tip, barb) for barb in barbs)])
        self._gravity = scene.add_line_segments(
            "/world/gravity", strokes, (250, 220, 90), thickness=3, thickness_units="screen"
        )

    def show(self, view: View) -> None:
        """Shows or hides it; where no support is known there is nothing to show."""
        layers, is_known = view.look.layers, view.problem.observation.support is not None
        self._grid.visible = "plane" in layers and is_known
        self._gravity.visible = "gravity" in layers and is_known
