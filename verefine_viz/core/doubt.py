"""Doubts about the data of a frame: what does not fit together, the evidence, and a remedy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from verefine_viz.core.settings import DataSettings

DoubtPicture = Literal["poses", "edges", "depth", "scene"]
"""What shows a doubt in the image: models as the data have them beside how they would fit; masks over the edges of
depth; the depth image; in 3D, so nothing there."""


class DoubtKind(StrEnum):
    """What a doubt is about."""

    DEPTH_SCALE = "depth_scale"
    DEPTH_STEPS = "depth_steps"
    DEPTH_DISTANCES = "depth_distances"
    DEPTH_SHIFT = "depth_shift"
    CAMERA = "camera"
    MODEL_SCALE = "model_scale"
    POSE_SCALE = "pose_scale"
    IN_METRES = "in_metres"
    CONVENTION = "convention"
    MASK = "mask"
    COLOUR = "colour"
    PLANE = "plane"
    MISFIT = "misfit"


@dataclass(frozen=True)
class KnownDoubt:
    """A kind of doubt, as the page shows it."""

    title: str
    """Words for a badge, where the doubt has none of its own."""
    picture: DoubtPicture


DOUBTS: Mapping[DoubtKind, KnownDoubt] = {
    DoubtKind.DEPTH_SCALE: KnownDoubt("depth in another unit", "poses"),
    DoubtKind.DEPTH_STEPS: KnownDoubt("depth in 8 bits", "depth"),
    DoubtKind.DEPTH_DISTANCES: KnownDoubt("depth along rays", "depth"),
    DoubtKind.DEPTH_SHIFT: KnownDoubt("depth displaced", "edges"),
    DoubtKind.CAMERA: KnownDoubt("K of another camera", "poses"),
    DoubtKind.MODEL_SCALE: KnownDoubt("model of another size", "poses"),
    DoubtKind.POSE_SCALE: KnownDoubt("poses in another unit", "poses"),
    DoubtKind.IN_METRES: KnownDoubt("data in metres", "poses"),
    DoubtKind.CONVENTION: KnownDoubt("poses of another convention", "poses"),
    DoubtKind.MASK: KnownDoubt("mask odd", "edges"),
    DoubtKind.COLOUR: KnownDoubt("colour displaced", "edges"),
    DoubtKind.PLANE: KnownDoubt("support plane off", "scene"),
    DoubtKind.MISFIT: KnownDoubt("data do not fit", "poses"),
}


@dataclass(frozen=True)
class Doubt:
    """A doubt about a frame's data: something does not fit together."""

    kind: DoubtKind
    text: str
    """What was seen and what to check, in a sentence without a full stop."""
    short: str = ""
    """In a few words, with a number; empty where the title of the kind says it."""
    instances: tuple[int, ...] = ()
    """The objects that show it; empty: the whole frame."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """The evidence. Names carry their unit."""
    remedy: DataSettings | None = None
    """Settings that would put the data right, in addition to present ones; None where no settings do."""
    other_settings: Mapping[str, Any] = field(default_factory=dict)
    """Other settings that would help, by dotted name, such as ``score.colour_weight``."""

    @property
    def title(self) -> str:
        """A few words for a badge."""
        return self.short or DOUBTS[self.kind].title

    def concerns(self, instance_id: int) -> bool:
        """Whether the doubt concerns an object, or the whole frame."""
        return not self.instances or instance_id in self.instances

    @property
    def picture(self) -> DoubtPicture:
        """What shows the doubt in the image."""
        return DOUBTS[self.kind].picture


def texts_of(doubts: Sequence[Doubt]) -> tuple[str, ...]:
    """Doubts as sentences, for run files and tables."""
    return tuple(doubt.text for doubt in doubts)


def times_words(factor: float) -> str:
    """A factor for a badge, as in ×0.1, ×1000 and ×0.63."""
    return f"×{factor:.3g}" if factor < 1000 else f"×{factor:.0f}"
