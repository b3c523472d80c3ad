"""Two runs in 3D: every object where A has it, solid, and where B has it, as an outline."""

from __future__ import annotations

from dataclasses import dataclass

import viser

from verefine_viz.core.palette import SIDE_COLORS
from verefine_viz.core.problem import Problem
from verefine_viz.viewer.stage_nodes import coarse_mesh, display_mesh, edges, place
from verefine_viz.viewer.view import View

OPACITY = 0.78
OUTLINE_PX = 2.2


@dataclass(frozen=True)
class _Pair:
    """One object twice."""

    solid: viser.SceneNodeHandle
    outline: viser.SceneNodeHandle


class SideNodes:
    """Holds the handles of a comparison's objects; nothing is made before something is compared."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._problem: Problem | None = None
        self._pairs: dict[int, _Pair] = {}

    def show(self, view: View) -> None:
        """Poses and visibility; call it after the frame was drawn, which takes older nodes away."""
        if view.problem is not self._problem:
            self._pairs, self._problem = {}, view.problem
        sides = view.sides
        if sides is None:
            for pair in self._pairs.values():
                pair.solid.visible = pair.outline.visible = False
            return
        for instance in view.problem.instances:
            own = instance.instance_id
            if own not in self._pairs:
                self._pairs[own] = self._make(view.problem, own)
            pair = self._pairs[own]
            T_a, T_b = sides.poses.get(own, (None, None))
            for node, T_cam_obj, side in ((pair.solid, T_a, "A"), (pair.outline, T_b, "B")):
                if T_cam_obj is not None:
                    place(node, T_cam_obj)
                node.visible = T_cam_obj is not None and side in sides.shown

    def _make(self, problem: Problem, instance_id: int) -> _Pair:
        scene, model = self._server.scene, problem.target(instance_id).model
        vertices, faces = display_mesh(model)
        solid = scene.add_mesh_simple(
            f"/cam/sides/a_{instance_id}", vertices, faces, color=SIDE_COLORS["A"], opacity=OPACITY, flat_shading=True,
            side="double", visible=False, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        outline = scene.add_line_segments(
            f"/cam/sides/b_{instance_id}", edges(*coarse_mesh(vertices, faces)), SIDE_COLORS["B"],
            thickness=OUTLINE_PX, thickness_units="screen", visible=False,
        )  # fmt: skip
        return _Pair(solid, outline)
