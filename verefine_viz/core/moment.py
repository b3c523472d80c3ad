"""A picture's worth of a run: an iteration, the poses to draw there, and the map that shows why."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from verefine_viz.core.arrays import Float
from verefine_viz.core.number_kinds import Id, Index
from verefine_viz.core.palette import OBJECT_COLORS, RGB, SCENE_COLORS, stage_color
from verefine_viz.core.records import StageName
from verefine_viz.core.scores import MapName

MomentKind = Literal["start", "before", "after", "gained", "answer", "truth", "also_fits", "against"]
MomentLayer = Literal["", "mask", "plane", "axes"]

ROLE_NAMES = {"best": "answer", "runner-up": "fits too"}
"""Words for roles in a film that are not named like stages."""
LAYER_COLORS: dict[str, tuple[str, RGB]] = {
    "mask": ("mask", OBJECT_COLORS[0]),
    "plane": ("support plane", SCENE_COLORS["plane"]),
}


class Moment(Struct, frozen=True, eq=False):
    """A key moment of what a run did to one object."""

    kind: MomentKind
    iteration: Index
    """0 = before the first; the answer stands at the last."""
    instance_id: Id
    stage: StageName | None
    """The last stage that is shown; None: all of the iteration."""
    poses: tuple[tuple[str, Float], ...]
    """(role, T_cam_obj (4, 4) [m]): roles are names of stages (``core/palette.py``). The map is that of the first."""
    caption: str
    """At most twelve words."""
    map: MapName = "classes"
    arm: Index | None = None
    """Index of the hypothesis that the moment is about; None = no single one."""
    layer: MomentLayer = ""
    """Further drawings: the object's mask, pixels on the support plane, axes of the first pose."""

    @property
    def title(self) -> str:
        """Place of the moment in the run, in a few words."""
        ends = {
            "answer": "Answer",
            "truth": "Ground truth",
            "also_fits": "Fits as well",
            "against": "What speaks against it",
        }
        at = ends.get(self.kind) or (f"Iteration {self.iteration}" if self.iteration else "Start")
        of = f", hyp. {self.arm + 1}" if self.arm is not None else ""
        return f"{at}{f', {self.kind}' if self.kind in ('before', 'after') else ''}{of}"

    @property
    def legend(self) -> dict[str, RGB]:
        """What is drawn over the photo: names and colours."""
        layer = [LAYER_COLORS[self.layer]] if self.layer in LAYER_COLORS else []
        return {ROLE_NAMES.get(role, role): stage_color(role) for role, _ in self.poses} | dict(layer)
