"""The ruler between two pixels: how far apart what the sensor saw there is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.observation import Observation
from verefine_viz.viewer.state.view_options import ViewOptions


@dataclass(frozen=True, eq=False)
class Ruler:
    """From one pixel to another."""

    start: tuple[int, int]
    """(u, v)."""
    end: tuple[int, int]
    points_cam: Float | None
    """(2, 3) the observed points of both [m]; None where the depth of one is unknown."""

    @property
    def label(self) -> str:
        """The distance [mm] and how much of it is along the optical axis; without depth, pixels."""
        if self.points_cam is None:
            return f"{np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]):.0f} px, no depth"
        along = 1000 * (self.points_cam[1] - self.points_cam[0])
        return f"{np.linalg.norm(along):.1f} mm, depth {along[2]:+.1f}"


def ruler_of(observation: Observation, options: ViewOptions) -> Ruler | None:
    """The ruler that is shown; None where there is none, or its end is not chosen yet."""
    start, end = options.ruler, options.pixel
    if start is None or end is None or start == end:
        return None
    depths_m = np.array([observation.depth_m[v, u] for u, v in (start, end)], np.float64)
    if not (depths_m > 0).all():
        return Ruler(start, end, None)
    camera, pixels = observation.camera, np.array([start, end], np.float64)
    across = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    return Ruler(start, end, np.column_stack([across, np.ones(2)]) * depths_m[:, None])


def ruler_html(ruler: Ruler, width: int, height: int) -> str:
    """A line over the photo of this size [px], and its length at the middle; placed as the photo is."""
    (u0, v0), (u1, v1) = ruler.start, ruler.end
    middle = f"--u:{(u0 + u1 + 1) / 2};--v:{(v0 + v1 + 1) / 2}"
    return (
        f'<svg class="image-canvas image-ruler" width="{width}" height="{height}">'
        f'<line x1="{u0 + 0.5}" y1="{v0 + 0.5}" x2="{u1 + 0.5}" y2="{v1 + 0.5}"/></svg>'
        f'<span class="image-length" style="{middle}">{ruler.label}</span>'
    )
