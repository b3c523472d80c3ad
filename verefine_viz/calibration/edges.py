"""Checks by their edges whether depth, colour and masks of a frame are aligned; no model or pose is needed.

Objects end where depth jumps, and mostly where colours change. The outlines of all masks are laid over the edges of
depth and of colour, and the edges of depth over those of colour, at every shift and mirrored. Where two of the three
are aligned, the third is off; where no two are, nothing is doubted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from verefine_viz.calibration.depth_shift import displaced_depth, where_px
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.doubt import Doubt, DoubtKind
from verefine_viz.core.problem import Problem

ROWS = 160
"""Rows of the reduced image in which edges are compared."""
REACH = 0.1
"""Largest displacement that is tried, as a share of the image's height."""
JUMP = 0.02
"""Share by which depth differs between neighbours where it jumps."""
FEWEST, MOST_COVERED = 100, 0.25
"""Fewest pixels of an edge that are evidence; and largest share of the image that objects may cover: too little is seen
beside larger ones."""
LIES_ON_PX, APART_PX = 8, 15
"""Edges are aligned if their best shift is at most the first, and displaced from the second on: sensors lose some
pixels of depth on one side of objects."""
SURE, BETTER, SURE_ALONE = 1.5, 0.35, 2.5
"""Least strength of edges under others that are aligned with them, as a multiple of the mean; least gain in strength by
the shift, as a share; and least strength where there is no colour to agree."""
ENDS_PX, SURE_MIRRORED, MIRRORED, PLAINLY = 2, 1.4, 5.0, 1.1
"""An object ends where a mask's outline is this near to a jump of depth. Colour is mirrored if there the mirrored image
changes this many times as much as elsewhere, and more than the given image by so many errors of the mean, and by this
factor."""


@dataclass(frozen=True)
class Shift:
    """The shift that aligns edges best with others [px]."""

    right: int
    down: int
    strength: float
    """Mean strength of the other edges under the shifted ones, as a multiple of their mean over the image."""
    before: float
    """Strength without the shift."""

    @property
    def back(self) -> Shift:
        """The opposite shift."""
        return replace(self, right=-self.right, down=-self.down)

    @property
    def numbers(self) -> dict[str, float]:
        """The shift as numbers of a doubt."""
        return {"right_px": self.right, "down_px": self.down}

    @property
    def is_sure(self) -> bool:
        """Whether both show the same edges."""
        return self.strength > SURE

    @property
    def lies_on(self) -> bool:
        """Whether both are aligned as they are."""
        return self.is_sure and max(abs(self.right), abs(self.down)) <= LIES_ON_PX

    @property
    def is_apart(self) -> bool:
        """Whether one is displaced against the other."""
        is_far = max(abs(self.right), abs(self.down)) >= APART_PX
        return self.is_sure and is_far and self.strength > (1 + BETTER) * self.before


def edge_doubts(problem: Problem) -> tuple[Doubt, ...]:
    """A doubt where one of depth, colour and masks is displaced against the others, or colour is mirrored."""
    seen = problem.observation
    step = max(1, seen.camera.height // ROWS)
    outlines = np.zeros(seen.depth_m[::step, ::step].shape, np.bool_)
    for instance in problem.instances:
        mask = instance.mask[::step, ::step]
        outlines |= mask & ~np.asarray(ndimage.binary_erosion(mask, border_value=1), np.bool_)
    jumps = depth_edges(seen.depth_m[::step, ::step])
    n_edges = min(np.count_nonzero(outlines), np.count_nonzero(jumps > 0.5))
    if n_edges < FEWEST or seen.object_mask.mean() > MOST_COVERED:
        return ()
    in_depth = _best_shift(outlines, jumps, step)
    if seen.rgb is None:
        if not (in_depth.is_apart and in_depth.strength > SURE_ALONE):
            return ()
        advice = "check that both are of one camera and image"
        return (_beside(in_depth, f"depth lies {_where(in_depth)} of where the masks are: {advice}"),)
    colours = _colour_edges(seen.rgb[::step, ::step])
    in_colour = _best_shift(outlines, colours, step)
    if in_depth.is_apart and in_colour.lies_on:
        advice = "warp it into the colour camera, or check that the images belong together"
        return (_beside(in_depth, f"depth lies {_where(in_depth)} of where colour and masks are: {advice}"),)
    if in_depth.is_apart and in_colour.is_apart and _best_shift(jumps > 0.5, colours, step).lies_on:
        advice = "check that the masks are of these images"
        text = f"masks lie {_where(in_depth.back)} of where depth and colour are: {advice}"
        return (Doubt(DoubtKind.MASK, text, "masks displaced", numbers=in_depth.back.numbers),)
    if not in_depth.lies_on:
        return ()
    if how := _mirrored(outlines, jumps > 0.5, colours):
        text = f"colour fits depth and masks once it is {how}: check whether it was {how} when it was stored"
        return (Doubt(DoubtKind.COLOUR, text, "colour mirrored"),)
    if in_colour.is_apart and _best_shift(jumps > 0.5, colours, step).is_apart:
        advice = "register it to the depth image"
        text = f"colour lies {_where(in_colour)} of where depth and masks are: {advice}"
        return (Doubt(DoubtKind.COLOUR, text, numbers=in_colour.numbers),)
    return ()


def _mirrored(outlines: Mask, jumps: Mask, colours: Float) -> str:
    """How to mirror colour so that it changes where masks and depth say that objects end; "" where no way is better."""
    ways = {
        "as it is": colours,
        "mirrored left to right": colours[:, ::-1],
        "mirrored upside down": colours[::-1],
        "turned by 180°": colours[::-1, ::-1],
    }
    ends = outlines & np.asarray(ndimage.binary_dilation(jumps, iterations=ENDS_PX), np.bool_)
    if np.count_nonzero(ends) < FEWEST:
        return ""
    best = max(ways, key=lambda how: float(ways[how][ends].mean()))
    gain = ways[best][ends] - colours[ends]
    mirrored, as_it_is = float(ways[best][ends].mean()), float(colours[ends].mean())
    is_better = gain.mean() > MIRRORED * gain.std() / np.sqrt(len(gain)) and mirrored > PLAINLY * as_it_is
    return best if is_better and mirrored > SURE_MIRRORED * colours.mean() else ""


def _best_shift(edges: Mask, others: Float, step: int) -> Shift:
    """The shift of ``edges`` (h, w) under which ``others`` (h, w) are strongest; their pixels are ``step`` px wide."""
    reach, inside = int(REACH * edges.shape[0]), np.ones_like(others)
    shape = (edges.shape[0] + 2 * reach, edges.shape[1] + 2 * reach)
    # The margin keeps shifts within reach from wrapping around.
    of_edges, *of_others = (
        np.asarray(fft.rfft2(np.pad(one.astype(np.float32), reach))) for one in (edges, others, inside)
    )
    sums, counts = (np.asarray(fft.irfft2(np.conj(of_edges) * one, shape)) for one in of_others)
    around = np.arange(-reach, reach + 1)
    sums, counts = sums[np.ix_(around, around)], counts[np.ix_(around, around)]
    means = sums / np.maximum(counts, FEWEST / 2) / max(float(others.mean()), 1e-6)
    down, right = np.unravel_index(int(means.argmax()), means.shape)
    return Shift(
        step * (int(right) - reach), step * (int(down) - reach), float(means.max()), float(means[reach, reach])
    )


def depth_edges(depth_m: NDArray[np.floating]) -> Float:
    """How much depth (h, w) jumps at each pixel, 0 to 1; the jump across a gap is in its middle."""
    if not (depth_m > 0).any():
        return np.zeros(depth_m.shape)
    nearest = ndimage.distance_transform_edt(depth_m <= 0, return_distances=False, return_indices=True)
    filled_m = depth_m[tuple(np.asarray(nearest))]
    jump = ndimage.maximum_filter(filled_m, 3) / ndimage.minimum_filter(filled_m, 3) - 1
    return np.clip(jump / JUMP - 0.5, 0, 1)


def _colour_edges(rgb: NDArray[np.uint8]) -> Float:
    """How much colours (h, w, 3) change at each pixel, as its rank in the image, squared, 0 to 1."""
    grey = ndimage.gaussian_filter(rgb.astype(np.float64), (1, 1, 0))
    change = np.sqrt(sum(ndimage.sobel(grey, axis) ** 2 for axis in (0, 1))).sum(axis=2)
    ranks = np.empty(change.size)
    ranks[change.ravel().argsort()] = np.linspace(0, 1, change.size)
    return ranks.reshape(change.shape) ** 2


def _beside(shift: Shift, text: str) -> Doubt:
    return displaced_depth(shift.right, shift.down, text)


def _where(shift: Shift) -> str:
    return f"about {where_px(shift.right, shift.down)}"
