"""Physics in 3D: contacts of the simulated path, what carries the object, and where objects overlap."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import viser

from verefine_viz.core.palette import RGB, SCENE_COLORS
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Contacts
from verefine_viz.page.scene3d.view_content import ViewContent

if TYPE_CHECKING:
    from verefine_viz.physics.proximity import Overlap

LIGHTS: dict[str, RGB] = {"green": (40, 180, 80), "amber": (217, 142, 4), "red": (220, 50, 47)}
_OVERLAP_PX = 4.0
_DEEP_COLOR, _DEEP_M = (220, 50, 47), 0.001
FORCE_M = 0.005
"""Length of a force's arrow per acceleration that it gives the object [m / (N/kg)]: MuJoCo's ``map.force``. The arrows
of what carries an object at rest add up to 5 cm, whatever its mass."""
_SHORTEST_M, _LONGEST = 0.001, 2.0
"""Shorter arrows are not drawn; longer ones [diameters] are cut, as where an object was pushed apart."""


def known_overlaps(content: ViewContent) -> list[Overlap]:
    """Return the overlaps of objects where they stand, as far as they were worked out."""
    pairs = [content.evaluator.known_overlap(one, other)[1] for one, other in combinations(content.placed.values(), 2)]
    return [overlap for overlap in pairs if overlap is not None and len(overlap.points_cam)]


def contacts_of(content: ViewContent) -> Contacts | None:
    """Return where the object in focus touches something: at a pose of the path, or at its end; None = nowhere."""
    path, at = content.path, content.path_moment
    if path is None or not path.contacts or at == 0:
        return None
    contacts = path.contacts[(len(path.contacts) if at is None else min(at, len(path.contacts))) - 1]
    return contacts if len(contacts.depths_m) else None


class PhysicsDrawing:
    """Made once per frame; what it draws was worked out by others."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._points: viser.PointCloudHandle | None = None
        self._arrows: viser.ArrowsHandle | None = None
        self._contacts: Contacts | None = None
        self._polygon = scene.add_line_segments(
            "/cam/support_polygon", np.zeros((1, 2, 3), np.float32), np.zeros((1, 2, 3), np.uint8), thickness=3,
            thickness_units="screen", visible=False,
        )  # fmt: skip
        self._carried: Any = None
        self._overlap_points: viser.PointCloudHandle | None = None
        self._overlaps: Sequence[Overlap] = ()

    def show(self, content: ViewContent, layers: frozenset[str], overlaps: Sequence[Overlap]) -> None:
        """Draw what is known of the content."""
        self._show_contacts(content, contacts_of(content) if "contacts" in layers else None)
        self._show_polygon(content, "contacts" in layers)
        self._show_overlaps(content, overlaps)

    def _show_contacts(self, content: ViewContent, contacts: Contacts | None) -> None:
        """Draw where the object touches something and the forces on it; None = nothing."""
        if contacts is not None and content.target is not None and contacts is not self._contacts:
            self._contacts = contacts
            self._draw_contacts(content, content.target, contacts)
        for nodes in (self._points, self._arrows):
            if nodes is not None:
                nodes.visible = contacts is not None

    def _draw_contacts(self, content: ViewContent, target: Target, contacts: Contacts) -> None:
        diameter_m, mass_kg = target.model.diameter_m, content.branch.settings.physics.mass_kg
        deep = contacts.depths_m > _DEEP_M
        colors = np.where(deep[:, None], _DEEP_COLOR, SCENE_COLORS["contacts"]).astype(np.uint8)
        points = contacts.points_cam.astype(np.float32)
        if self._points is None:
            self._points = self._scene.add_point_cloud(
                "/cam/contact_points", points, colors, precision="float32", point_shape="circle", point_shading="flat"
            )
        self._points.points, self._points.colors, self._points.point_size = points, colors, 0.03 * diameter_m
        lengths_m = np.minimum(FORCE_M * contacts.forces_n / mass_kg, _LONGEST * diameter_m)
        long = lengths_m > _SHORTEST_M
        ends = np.stack([contacts.points_cam, contacts.points_cam + lengths_m[:, None] * contacts.normals_cam], axis=1)
        if self._arrows is None:
            self._arrows = self._scene.add_arrows("/cam/contacts", ends[long].astype(np.float32), colors[long])
        self._arrows.points, self._arrows.colors = ends[long].astype(np.float32), colors[long]
        self._arrows.shaft_radius, self._arrows.head_radius = 0.006 * diameter_m, 0.018 * diameter_m
        self._arrows.head_length = 0.04 * diameter_m

    def _show_polygon(self, content: ViewContent, is_drawn: bool) -> None:
        """Draw the support polygon on the plane, and a line down from the centre of mass, where they are known."""
        known = None
        if content.target is not None and content.main is not None and is_drawn:
            T_cam_obj, others = content.main.T_cam_obj, content.others
            known = content.evaluator.known_plausibility(content.target, T_cam_obj, others)
        self._polygon.visible = known is not None
        if known is not None and known is not self._carried:
            self._carried = known
            corners = known.polygon_cam
            sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            down = np.stack([known.com_cam, known.com_on_plane_cam])[None]
            self._polygon.points = np.concatenate([sides, down]).astype(np.float32)
            self._polygon.colors = np.full((len(sides) + 1, 2, 3), LIGHTS[known.light], np.uint8)

    def _show_overlaps(self, content: ViewContent, overlaps: Sequence[Overlap]) -> None:
        """Draw red points where objects are partly in the same place."""
        if self._overlap_points is not None:
            self._overlap_points.visible = bool(overlaps)
        if overlaps and [*map(id, overlaps)] != [*map(id, self._overlaps)]:
            points = np.concatenate([overlap.points_cam for overlap in overlaps]).astype(np.float32)
            camera = content.problem.observation.camera
            self._overlap_points = self._scene.add_point_cloud(
                "/cam/overlaps", points, SCENE_COLORS["overlaps"], precision="float32", point_shape="circle",
                point_shading="flat", point_size=float(np.median(points[:, 2])) / camera.fx * _OVERLAP_PX,
            )  # fmt: skip
        self._overlaps = overlaps or self._overlaps
