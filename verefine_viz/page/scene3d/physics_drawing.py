"""Physics in 3D: contacts of the simulated path, what carries the object, and where objects overlap."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import viser

from verefine_viz.core.palette import RGB
from verefine_viz.core.records import Contacts
from verefine_viz.page.moment import Moment
from verefine_viz.page.protocol import Look

if TYPE_CHECKING:
    from verefine_viz.physics.proximity import Overlap

LIGHTS: dict[str, RGB] = {"green": (40, 180, 80), "amber": (217, 142, 4), "red": (220, 50, 47)}
_OVERLAP_COLOR = (255, 30, 30)
_OVERLAP_PX = 4.0
_CONTACT_COLOR, _DEEP_COLOR = (255, 140, 0), (220, 50, 47)
_DEEP_M = 0.001
_ARROW = 0.35
"""Length of a contact's arrow [diameter of the object]."""


def known_overlaps(moment: Moment) -> list[Overlap]:
    """Return the overlaps of objects where they stand, as far as they were worked out."""
    placed = [o.placed for o in moment.objects if o.placed is not None]
    pairs = [moment.evaluator.known_overlap(one, other)[1] for one, other in combinations(placed, 2)]
    return [overlap for overlap in pairs if overlap is not None and len(overlap.points_cam)]


class PhysicsDrawing:
    """Made once per frame; what it draws was worked out by others."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._arrows: viser.ArrowsHandle | None = None
        self._contacts: Contacts | None = None
        self._polygon = scene.add_line_segments(
            "/cam/support_polygon", np.zeros((1, 2, 3), np.float32), np.zeros((1, 2, 3), np.uint8), thickness=3,
            thickness_units="screen", visible=False,
        )  # fmt: skip
        self._carried: Any = None
        self._overlap_points: viser.PointCloudHandle | None = None
        self._overlaps: Sequence[Overlap] = ()

    def show(self, moment: Moment, look: Look, layers: frozenset[str], overlaps: Sequence[Overlap]) -> None:
        """Draw what is known at a moment."""
        self._show_contacts(moment, look, "contacts" in layers)
        self._show_polygon(moment, "contacts" in layers)
        self._show_overlaps(moment, overlaps)

    def _show_contacts(self, moment: Moment, look: Look, is_drawn: bool) -> None:
        """Draw arrows onto the object where it touches something: at a pose of the path, or at its end."""
        path = moment.iteration.path if moment.iteration is not None and not moment.is_answer else None
        contacts = None
        if path is not None and path.contacts and look.moment != 0 and "edited" not in moment.poses:
            k = len(path.contacts) if look.moment is None else min(look.moment, len(path.contacts))
            contacts = path.contacts[k - 1]
        is_drawn = is_drawn and contacts is not None and len(contacts.depths_m) > 0
        if contacts is not None and is_drawn and contacts is not self._contacts:
            self._contacts = contacts
            length_m = _ARROW * moment.target.model.diameter_m
            ends = np.stack([contacts.points_cam - length_m * contacts.normals_cam, contacts.points_cam], axis=1)
            deep = contacts.depths_m > _DEEP_M
            colors = np.where(deep[:, None], _DEEP_COLOR, _CONTACT_COLOR).astype(np.uint8)
            if self._arrows is None:
                self._arrows = self._scene.add_arrows("/cam/contacts", ends.astype(np.float32), colors)
            self._arrows.points, self._arrows.colors = ends.astype(np.float32), colors
            self._arrows.shaft_radius, self._arrows.head_radius = 0.008 * length_m, 0.03 * length_m
            self._arrows.head_length = 0.12 * length_m
        if self._arrows is not None:
            self._arrows.visible = is_drawn

    def _show_polygon(self, moment: Moment, is_drawn: bool) -> None:
        """Draw the support polygon on the plane, and a line down from the centre of mass, where they are known."""
        focus = moment.target.instance.instance_id
        name = next((name for name in ("edited", "accepted", "best") if name in moment.poses), None)
        known = None
        if name is not None and is_drawn:
            others = moment.others_of(focus)
            known = moment.evaluator.known_plausibility(moment.target, moment.poses[name], others)
        self._polygon.visible = known is not None
        if known is not None and known is not self._carried:
            self._carried = known
            corners = known.polygon_cam
            sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            down = np.stack([known.com_cam, known.com_on_plane_cam])[None]
            self._polygon.points = np.concatenate([sides, down]).astype(np.float32)
            self._polygon.colors = np.full((len(sides) + 1, 2, 3), LIGHTS[known.light], np.uint8)

    def _show_overlaps(self, moment: Moment, overlaps: Sequence[Overlap]) -> None:
        """Draw red points where objects are partly in the same place."""
        if self._overlap_points is not None:
            self._overlap_points.visible = bool(overlaps)
        if overlaps and [*map(id, overlaps)] != [*map(id, self._overlaps)]:
            points = np.concatenate([overlap.points_cam for overlap in overlaps]).astype(np.float32)
            camera = moment.problem.observation.camera
            self._overlap_points = self._scene.add_point_cloud(
                "/cam/overlaps", points, _OVERLAP_COLOR, precision="float32", point_shape="circle",
                point_shading="flat", point_size=float(np.median(points[:, 2])) / camera.fx * _OVERLAP_PX,
            )  # fmt: skip
        self._overlaps = overlaps or self._overlaps
