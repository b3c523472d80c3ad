"""The verification score of poses, with the parts and maps that explain it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, frozen, set_fields
from verefine_viz.core.number_kinds import Real

PIXEL_CLASSES = ("explained", "missed", "protruding", "hidden", "unknown")
"""Column order of ``counts`` and value − 1 of ``ScoreMaps.classes`` (0 = not part of the score).

explained: in the object's mask, rendered and observed agree within τ. missed: the object's mask was observed, the pose
leaves it empty or puts it behind what was observed. protruding: the pose puts surface where the sensor saw through, or
outside the mask onto another surface. hidden: something nearer stands in front, outside the mask or known from placed
objects. unknown: rendered, but nothing was measured there.
"""
MapName = Literal[
    "observed", "rendered", "difference", "angle", "f_d", "f_n", "classes", "observed_colour", "rendered_colour",
    "correlation",
]  # fmt: skip
"""Maps that can be shown: the sensor's depth, and those of :class:`ScoreMaps`."""
MAP_NAMES: tuple[MapName, ...] = get_args(MapName)
COLOUR_MAPS: tuple[MapName, ...] = ("observed_colour", "rendered_colour", "correlation")
"""The maps without a value where the colour term is off."""


Pixels = Annotated[int, Meta(ge=0, le=2**53)]


class PoseScore(Struct, frozen=True, eq=False):
    """The score of one pose."""

    score: Real
    """f̄ of Eq. 1 in [0, 1], with colour (1 − w) f̄ + w max(f_c, 0), and so on with plausibility; 0 where it is
    undefined."""
    depth_fit: float
    """Mean f_d over the counted pixels; NaN, as the next one, where the score is not of Eq. 1 and has no parts."""
    normal_fit: float
    """Mean f_n over the counted pixels."""
    n_pixels: Pixels
    """N, the counted pixels."""
    n_rendered: Pixels
    """Pixels on which the model appears, or its points in the image where nothing is rendered; 0: it is not seen."""
    counts: tuple[Pixels, Pixels, Pixels, Pixels, Pixels]
    """Pixels of each of ``PIXEL_CLASSES``."""
    undefined: bool = False
    """Whether the verifier gave something that is not a number; ``score`` is 0 then."""
    colour_fit: Real | None = None
    """f_c, correlation of rendered and observed colour over the explained pixels in [−1, 1]; None where the term is
    off."""
    colour_weight: Real = 0.0
    """w, 0 where the term is off; the same for all poses of an object."""
    plausibility: Real | None = None
    """p in [0, 1]: whether the object could be there (docs/methods.md 1.14); None where the term is off."""
    plausibility_weight: Real = 0.0

    @property
    def has_parts(self) -> bool:
        """Whether it is a score of Eq. 1, with fits and counts of pixels."""
        return not math.isnan(self.depth_fit)

    @property
    def colour_part(self) -> float:
        """Part of the score that comes from colour: w max(f_c, 0), times the share that plausibility leaves."""
        return (1 - self.plausibility_weight) * self.colour_weight * max(self.colour_fit or 0.0, 0.0)

    @property
    def shares(self) -> dict[str, float]:
        """Each class as a share of all classified pixels; all 0 where nothing is classified."""
        total = max(sum(self.counts), 1)
        return {name: count / total for name, count in zip(PIXEL_CLASSES, self.counts, strict=True)}


@dataclass(frozen=True, eq=False)
class Scores:
    """The scores of N poses, as columns."""

    score: Float
    depth_fit: Float
    normal_fit: Float
    n_pixels: NDArray[np.int64]
    n_rendered: NDArray[np.int64]
    counts: NDArray[np.int64]
    """(N, 5) in the order of ``PIXEL_CLASSES``."""
    undefined: NDArray[np.bool_] | None = None
    """(N,) which scores were not a number (NaN, infinite) and are 0 instead; None where all were. Set here."""
    colour_fit: Float | None = None
    """(N,) f_c; None where the term is off."""
    colour_weight: float = 0.0
    plausibility: Float | None = None
    """(N,) p; None where the term is off."""
    plausibility_weight: float = 0.0

    def __post_init__(self) -> None:
        score, defined = self.score, np.isfinite(self.score)
        if not defined.all():
            # Worth nothing (docs/methods.md 1.8.6), and an event of the iteration.
            score = np.where(defined, score, 0.0)
            set_fields(self, undefined=frozen(~defined, "undefined scores", (None,), np.bool_))
        set_fields(self, score=frozen(score, "score", (None,)))

    def __len__(self) -> int:
        return len(self.score)

    def __getitem__(self, i: int) -> PoseScore:
        c = self.counts[i]
        return PoseScore(
            float(self.score[i]),
            float(self.depth_fit[i]),
            float(self.normal_fit[i]),
            int(self.n_pixels[i]),
            int(self.n_rendered[i]),
            (int(c[0]), int(c[1]), int(c[2]), int(c[3]), int(c[4])),
            self.undefined is not None and bool(self.undefined[i]),
            None if self.colour_fit is None else float(self.colour_fit[i]),
            self.colour_weight,
            None if self.plausibility is None else float(self.plausibility[i]),
            self.plausibility_weight,
        )


@dataclass(frozen=True, eq=False)
class PixelGrid:
    """The pixels where some rows and some columns of the image cross, in any order and as often as wanted."""

    rows: NDArray[np.int64]
    """(h,)."""
    columns: NDArray[np.int64]
    """(w,)."""

    @staticmethod
    def whole(shape: tuple[int, int]) -> PixelGrid:
        """All pixels of an image (H, W)."""
        return PixelGrid(np.arange(shape[0]), np.arange(shape[1]))


@dataclass(frozen=True, eq=False)
class ScoreMaps:
    """The score of one pose, pixel by pixel; made only when it is shown or recorded.

    (H, W) is the size of the image, or of the :class:`PixelGrid` that was asked for. Over a whole image the mean of
    ``f_d`` and of ``f_n`` over ``counted`` are the score's parts.
    """

    rendered_m: NDArray[np.float32]
    """(H, W) depth of the model under the pose [m]; 0 = empty."""
    rendered_normals: NDArray[np.float32]
    """(H, W, 3) camera frame."""
    depth_difference_m: NDArray[np.float32]
    """(H, W) observed − rendered [m]; NaN where one of them is missing."""
    angle_rad: NDArray[np.float32]
    """(H, W) angle between observed and rendered normal [rad]; NaN where one is missing."""
    f_d: NDArray[np.float32]
    f_n: NDArray[np.float32]
    counted: NDArray[np.bool_]
    """(H, W) pixels that are part of N."""
    classes: NDArray[np.uint8]
    """(H, W) 0 = none, 1 + index into ``PIXEL_CLASSES``."""
    observed_rgb: NDArray[np.uint8] | None = None
    """(H, W, 3) the image as the colour term sees it, smoothed; None where the term is off, and so are those below."""
    rendered_rgb: NDArray[np.uint8] | None = None
    """(H, W, 3) the model's colours under the pose, without light; black where there are none."""
    correlation: NDArray[np.float32] | None = None
    """(H, W) what each explained pixel adds to f_c, times their number: its mean over those that count (column + row
    even) is f_c; NaN elsewhere."""
