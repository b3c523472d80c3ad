"""One object in 3D: its body where it stands, other poses as outlines or axes, as ghosts its hypotheses and what the
image allows, and its name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import viser
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, quat_wxyz
from verefine_viz.core.palette import OBJECT_COLORS, RGB, SCENE_COLORS, SIDE_COLORS, rank_colors, stage_color
from verefine_viz.core.problem import Target
from verefine_viz.page.scene3d.drawn_models import (
    LABEL_PX,
    Mesh,
    add_coloured,
    add_outline,
    add_solid,
    display_mesh,
    outline_of,
    show_at,
)

OUTLINE_PX = 2.0
_ABOVE_M = 0.012
_GHOST_OPACITY = 0.22
_ALLOWED_OPACITY = 0.2
_AXES_RADII = 1.1
"""Length of a pose's axes, in radii of its object."""
_AXIS_SHARE = 0.03
"""Radius of an axis, of its length."""
BodyLook = tuple[RGB, float] | Literal["own colours"]
"""A colour with an opacity, or the colours of the model."""


class ObjectDrawing:
    """An object's nodes: made when they are needed first, then moved, coloured and hidden."""

    def __init__(self, scene: viser.SceneApi, target: Target, label: str, up_cam: Float) -> None:
        self._scene, self._model, self._up_cam = scene, target.model, up_cam
        self._name = f"/cam/objects/{target.instance.instance_id}"
        self._solid = add_solid(scene, f"{self._name}/solid", display_mesh(self._model), OBJECT_COLORS[0])
        self._coloured = add_coloured(scene, f"{self._name}/coloured", self._model)
        self._label = scene.add_label(f"{self._name}/name", label, anchor="bottom-center", visible=False)
        self._look: tuple[RGB, float] | None = None
        self._outlines: dict[str, viser.LineSegmentsHandle] = {}
        mesh = display_mesh(self._model)
        self._hypotheses = GhostDrawing(scene, f"{self._name}/hypotheses", mesh, _GHOST_OPACITY)
        self._allowed = GhostDrawing(scene, f"{self._name}/allowed", mesh, _ALLOWED_OPACITY)
        self._axes: list[viser.FrameHandle] = []

    def show_body(self, T_cam_obj: Float | None, look: BodyLook) -> None:
        """Draw the object where it stands; None = nowhere. Without own colours it is white where these are asked."""
        own = look == "own colours" and self._coloured is not None
        show_at(self._coloured, T_cam_obj if own else None)
        show_at(self._solid, None if own else T_cam_obj)
        plain = ((255, 255, 255), 1.0) if isinstance(look, str) else look
        if not own and plain != self._look:
            self._look = plain
            self._solid.color, self._solid.opacity = plain

    def show_name(self, T_cam_obj: Float | None, text_px: float) -> None:
        """Write the name above where the object stands; None = not at all."""
        self._label.font_screen_scale = text_px / LABEL_PX
        self._label.visible = T_cam_obj is not None
        if T_cam_obj is not None:
            points = apply(T_cam_obj, self._model.points[::4])
            heights, middle = points @ self._up_cam, points.mean(axis=0)
            self._label.position = middle + (heights.max() - middle @ self._up_cam + _ABOVE_M) * self._up_cam

    def show_outlines(self, poses: Mapping[str, Float]) -> None:
        """Outline the object at poses, by the names of stages, or "B"."""
        for name in [name for name in poses if name not in self._outlines]:
            color = SIDE_COLORS[name] if name in SIDE_COLORS else stage_color(name)
            node = f"{self._name}/outline_{name.replace(' ', '_')}"
            self._outlines[name] = add_outline(self._scene, node, outline_of(self._model), color, OUTLINE_PX)
        for name, node in self._outlines.items():
            show_at(node, poses.get(name))

    def show_hypotheses(self, Ts: Float, shares: Float, chosen: int) -> None:
        """Draw hypotheses at poses (n, 4, 4), coloured by their ranks (n,) in [0, 1], and one more clearly."""
        opacities = np.where(np.arange(len(Ts)) == chosen, 2.0, 1.0).astype(np.float32)
        self._hypotheses.show(Ts, rank_colors(shares), opacities)

    def show_allowed(self, Ts: Float) -> None:
        """Draw the poses (n, 4, 4) that the image allows, faintly."""
        colors = np.tile(np.array(SCENE_COLORS["allowed"], np.uint8), (len(Ts), 1))
        self._allowed.show(Ts, colors, np.ones(len(Ts), np.float32))

    def show_axes(self, Ts: Float) -> None:
        """Draw the axes of poses (n, 4, 4), the first with thicker ones."""
        length_m = _AXES_RADII * self._model.diameter_m / 2
        while len(self._axes) < len(Ts):
            radius_m = length_m * (_AXIS_SHARE if not self._axes else _AXIS_SHARE / 2)
            name = f"{self._name}/axes_{len(self._axes)}"
            self._axes.append(
                self._scene.add_frame(name, axes_length=length_m, axes_radius=radius_m, origin_radius=radius_m)
            )
        for k, node in enumerate(self._axes):
            show_at(node, Ts[k] if k < len(Ts) else None)


class GhostDrawing:
    """A mesh at many poses at once, faint; made when it is first needed, then moved, coloured and hidden."""

    def __init__(self, scene: viser.SceneApi, name: str, mesh: Mesh, opacity: float) -> None:
        self._scene, self._name, self._mesh, self._opacity = scene, name, mesh, opacity
        self._ghosts: viser.BatchedMeshHandle | None = None
        self._shown: tuple[bytes, bytes] = (b"", b"")

    def show(self, Ts: Float, colors: NDArray[np.uint8], opacities: NDArray[np.float32]) -> None:
        """Draw it at poses (n, 4, 4), in colours (n, 3), with opacities (n,) relative to its own."""
        n = len(Ts)
        if not n:
            if self._ghosts is not None:
                self._ghosts.visible = False
            return
        if self._ghosts is None or len(self._ghosts.batched_positions) != n:  # Another branch may have more.
            # Front faces alone: transparent ones of both sides are drawn in two passes, which software renderers feel.
            self._ghosts = self._scene.add_batched_meshes_simple(
                self._name, *self._mesh, np.tile([1.0, 0, 0, 0], (n, 1)), np.zeros((n, 3)),
                batched_colors=np.zeros((n, 3), np.uint8), batched_opacities=np.ones(n), opacity=self._opacity,
                lod="off", side="front", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self._shown = (b"", b"")
        key = (Ts.tobytes(), colors.tobytes() + opacities.tobytes())
        if key[0] != self._shown[0]:
            self._ghosts.batched_positions = Ts[:, :3, 3].astype(np.float32)
            self._ghosts.batched_wxyzs = np.array([quat_wxyz(T[:3, :3]) for T in Ts], np.float32)
        if key[1] != self._shown[1]:
            self._ghosts.batched_colors, self._ghosts.batched_opacities = colors, opacities
        self._shown = key
        self._ghosts.visible = True
