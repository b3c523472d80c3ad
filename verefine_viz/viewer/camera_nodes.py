"""The sensor in 3D: its pyramid of view, and in it the image, with the score map over it."""

from __future__ import annotations

import numpy as np
import viser

from verefine_viz.viewer.maps import map_over
from verefine_viz.viewer.view import View

IMAGE_PLANE_M = 0.12
"""How far before the sensor its image hangs in the scene [m]."""


class CameraNodes:
    """Made once per frame; afterwards the picture and visibility change."""

    def __init__(self, scene: viser.SceneApi, view: View) -> None:
        camera = view.problem.observation.camera
        height = camera.height / camera.fy * IMAGE_PLANE_M
        width = camera.width / camera.fx * IMAGE_PLANE_M
        left, right = -camera.cx / camera.fx, (camera.width - camera.cx) / camera.fx
        top, bottom = -camera.cy / camera.fy, (camera.height - camera.cy) / camera.fy
        corners = np.array([[left, top, 1], [right, top, 1], [right, bottom, 1], [left, bottom, 1]]) * IMAGE_PLANE_M
        edges = [(np.zeros(3), corner) for corner in corners] + [(corners[k], corners[(k + 1) % 4]) for k in range(4)]
        self._frustum = scene.add_line_segments(
            "/cam/frustum", np.array(edges), (140, 140, 140), thickness=1.5, thickness_units="screen"
        )
        photo = view.problem.observation.rgb
        self._darkened = np.full((*camera.shape, 3), 60, np.uint8) if photo is None else (photo * 0.55).astype(np.uint8)
        image = photo if photo is not None else np.full((*camera.shape, 3), 90, np.uint8)
        centre = (
            ((camera.width - 1) / 2 - camera.cx) / camera.fx * IMAGE_PLANE_M,
            ((camera.height - 1) / 2 - camera.cy) / camera.fy * IMAGE_PLANE_M,
            IMAGE_PLANE_M,
        )
        self._image = scene.add_image(
            "/cam/image", image, width, height, format="jpeg", jpeg_quality=85, position=centre, cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip
        self._shown = image

    def show(self, view: View) -> None:
        """Shows or hides it."""
        self._image.visible = self._frustum.visible = "camera image" in view.look.layers

    def show_map(self, view: View) -> None:
        """Lays the score map that is looked at over the image."""
        side = view.b or view.a
        if not self._image.visible or side is None or side.maps is None:
            return
        image = map_over(self._darkened, view.look.map, side.maps, view.map_target, view.session.score.tau_m)
        if view.look.pixel is not None:
            u, v = view.look.pixel
            image[max(v - 4, 0) : v + 5, u] = image[v, max(u - 4, 0) : u + 5] = (255, 255, 255)
        if not np.array_equal(image, self._shown):
            self._image.image = image
            self._shown = image
