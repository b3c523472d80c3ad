"""The user's marks in 3D: the ray of a pixel, the point that it sees with its normal, and a distance."""

from __future__ import annotations

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.observation import Observation
from verefine_viz.core.palette import SCENE_COLORS
from verefine_viz.page.protocol import Pixel
from verefine_viz.page.scene3d.drawn_models import LABEL_PX

_BLIND_M = 1.0
"""Length of the ray of a pixel where nothing was measured [m]."""
_CROSS, _NORMAL = 0.015, 0.05
"""Half the size of a cross and the length of a normal [distance from the camera]."""
_LINE_PX = 2.5


class MarkDrawing:
    """Made once per frame."""

    def __init__(self, scene: viser.SceneApi, observation: Observation) -> None:
        self._observation = observation
        self._lines = scene.add_line_segments(
            "/cam/marked", np.zeros((1, 2, 3), np.float32), SCENE_COLORS["marked"], thickness=_LINE_PX,
            thickness_units="screen", visible=False,
        )  # fmt: skip
        self._words = scene.add_label("/cam/distance", "", anchor="bottom-center", visible=False)
        self._shown: tuple[Pixel | None, tuple[Pixel, Pixel] | None] = (None, None)

    def show(self, pixel: Pixel | None, ruler: tuple[Pixel, Pixel] | None, text_px: float) -> None:
        """Draw a marked pixel and the distance between two; None = nothing."""
        ends = [self._point(one) for one in ruler or ()]
        self._words.font_screen_scale = text_px / LABEL_PX
        if (pixel, ruler) == self._shown:
            return
        self._shown = pixel, ruler
        lines = [] if pixel is None else self._ray(pixel)
        known = [end for end in ends if end is not None]
        for end in known:
            lines += _cross(end)
        if len(known) == 2:
            lines.append(np.array(known))
            self._words.text = f"{1000 * np.linalg.norm(known[1] - known[0]):.1f} mm"
            self._words.position = (known[0] + known[1]) / 2
        self._words.visible = len(known) == 2
        self._lines.visible = bool(lines)
        if lines:
            self._lines.points = np.array(lines, np.float32)
            self._lines.colors = np.full((len(lines), 2, 3), SCENE_COLORS["marked"], np.uint8)

    def _point(self, pixel: Pixel) -> Float | None:
        """Return the point (3,) that a pixel sees; None where nothing was measured or there is no such pixel."""
        (u, v), depth_m = pixel, self._observation.depth_m
        if not (v < depth_m.shape[0] and u < depth_m.shape[1] and depth_m[v, u] > 0):
            return None
        return float(depth_m[v, u]) * self._direction(pixel)

    def _direction(self, pixel: Pixel) -> Float:
        """Return the point (3,) on a pixel's ray at a depth of 1 m."""
        camera = self._observation.camera
        return np.array([(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1.0])

    def _ray(self, pixel: Pixel) -> list[Float]:
        """Return the lines (2, 3) that mark a pixel: its ray, and the point that it sees with its normal."""
        point = self._point(pixel)
        if point is None:
            return [np.array([np.zeros(3), _BLIND_M * self._direction(pixel)])]
        normal = self._observation.normals_cam[pixel[1], pixel[0]]
        up = np.array([point, point + _NORMAL * np.linalg.norm(point) * normal])
        return [np.array([np.zeros(3), point]), *_cross(point), *([up] if normal.any() else [])]


def _cross(point: Float) -> list[Float]:
    """Return three lines (2, 3) along the camera's axes through a point (3,)."""
    reach_m = _CROSS * np.linalg.norm(point)
    return [np.array([point - reach_m * axis, point + reach_m * axis]) for axis in np.eye(3)]
