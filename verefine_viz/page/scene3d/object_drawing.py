"""One object in 3D: its body where it stands, its other poses as outlines, its hypotheses as ghosts, its name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import viser

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, quat_wxyz
from verefine_viz.core.palette import FIT, OBJECT_COLORS, RGB, SIDE_COLORS, STAGE_COLORS
from verefine_viz.core.problem import Target
from verefine_viz.methods.arms import Arm
from verefine_viz.page.scene3d.drawn_models import (
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
_NAME_SIZE = 0.65
"""Against viser's own size: objects stand close, and names must not hide each other."""
BodyLook = tuple[RGB, float] | Literal["own colours"]
"""A colour with an opacity, or the colours of the model."""


class ObjectDrawing:
    """An object's nodes: made when they are needed first, then moved, coloured and hidden."""

    def __init__(self, scene: viser.SceneApi, target: Target, label: str, up_cam: Float) -> None:
        self._scene, self._model, self._up_cam = scene, target.model, up_cam
        self._name = f"/cam/objects/{target.instance.instance_id}"
        self._solid = add_solid(scene, f"{self._name}/solid", display_mesh(self._model), OBJECT_COLORS[0])
        self._coloured = add_coloured(scene, f"{self._name}/coloured", self._model)
        self._label = scene.add_label(
            f"{self._name}/name", label, font_screen_scale=_NAME_SIZE, anchor="bottom-center", visible=False
        )
        self._look: tuple[RGB, float] | None = None
        self._outlines: dict[str, viser.LineSegmentsHandle] = {}
        self._ghosts: viser.BatchedMeshHandle | None = None
        self._ghosts_shown: tuple[bytes, bytes] = (b"", b"")

    def show_body(self, T_cam_obj: Float | None, look: BodyLook) -> None:
        """Draw the object where it stands; None = nowhere. Without own colours it is white where these are asked."""
        own = look == "own colours" and self._coloured is not None
        show_at(self._coloured, T_cam_obj if own else None)
        show_at(self._solid, None if own else T_cam_obj)
        plain = ((255, 255, 255), 1.0) if isinstance(look, str) else look
        if not own and plain != self._look:
            self._look = plain
            self._solid.color, self._solid.opacity = plain

    def show_name(self, T_cam_obj: Float | None) -> None:
        """Write the name above where the object stands; None = not at all."""
        self._label.visible = T_cam_obj is not None
        if T_cam_obj is not None:
            points = apply(T_cam_obj, self._model.points[::4])
            heights, middle = points @ self._up_cam, points.mean(axis=0)
            self._label.position = middle + (heights.max() - middle @ self._up_cam + _ABOVE_M) * self._up_cam

    def show_outlines(self, poses: Mapping[str, Float]) -> None:
        """Outline the object at poses, by the names of stages, or "B"."""
        for name in [name for name in poses if name not in self._outlines]:
            color = SIDE_COLORS[name] if name in SIDE_COLORS else STAGE_COLORS[name]
            node = f"{self._name}/outline_{name.replace(' ', '_')}"
            self._outlines[name] = add_outline(self._scene, node, outline_of(self._model), color, OUTLINE_PX)
        for name, node in self._outlines.items():
            show_at(node, poses.get(name))

    def show_hypotheses(self, arms: Sequence[Arm], chosen: int) -> None:
        """Draw where the hypotheses are now, yellow = the highest score, violet = the lowest, and one more clearly."""
        n = len(arms)
        if not n:
            if self._ghosts is not None:
                self._ghosts.visible = False
            return
        if self._ghosts is None or len(self._ghosts.batched_positions) != n:  # Another branch may have more.
            # Front faces alone: transparent ones of both sides are drawn in two passes, which software renderers feel.
            self._ghosts = self._scene.add_batched_meshes_simple(
                f"{self._name}/hypotheses", *display_mesh(self._model), np.tile([1.0, 0, 0, 0], (n, 1)),
                np.zeros((n, 3)), batched_colors=np.zeros((n, 3), np.uint8), batched_opacities=np.ones(n),
                opacity=_GHOST_OPACITY, lod="off", side="front", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self._ghosts_shown = (b"", b"")
        Ts = np.array([arm.current.T_cam_obj for arm in arms])
        ranks = np.argsort(np.argsort([arm.current.score.score for arm in arms])) / max(n - 1, 1)
        colors = FIT.colors(ranks)
        opacities = np.where(np.arange(n) == chosen, 2.0, 1.0).astype(np.float32)
        key = (Ts.tobytes(), colors.tobytes() + opacities.tobytes())
        if key[0] != self._ghosts_shown[0]:
            self._ghosts.batched_positions = Ts[:, :3, 3].astype(np.float32)
            self._ghosts.batched_wxyzs = np.array([quat_wxyz(T[:3, :3]) for T in Ts], np.float32)
        if key[1] != self._ghosts_shown[1]:
            self._ghosts.batched_colors, self._ghosts.batched_opacities = colors, opacities
        self._ghosts_shown = key
        self._ghosts.visible = True
