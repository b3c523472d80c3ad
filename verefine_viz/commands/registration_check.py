"""Whether measured depth lies where the true poses of a data set say that objects are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Placed
from verefine_viz.scenes.bop import BopDataset
from verefine_viz.scenes.segments import draw_placed

Pixels = NDArray[np.intp]

NEAR_M = 0.015
"""Measured and rendered depth that differ by less agree [m] (BOP's visibility tolerance)."""
SHIFTS_PX = range(-30, 31, 3)
"""Displacements that are tried to see whether depth is registered to colour [px]."""
GAIN = 0.15
"""So much more of the pixels must agree after a displacement for it to be the explanation."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """A frame with true poses."""

    seen_m: Float
    """(H, W) measured depth [m], 0 where there is none."""
    camera: Camera
    placed: tuple[Placed, ...]


def registration(
    dataset: BopDataset, sampled: Sequence[tuple[int, int]], is_in_place: bool
) -> Iterator[tuple[str, str]]:
    """What was found, and what to do about it (empty = nothing): once, or never where no object is in any image.

    Where depth does not lie where the true poses say, whether it does when displaced or rescaled. Displaced depth is
    none of a wrong cam_K, which displaces the drawn models: masks must lie over these (``is_in_place``).
    """
    frames = list(_frames(dataset, sampled))
    times = _times_as_far(frames)
    if times is not None:
        guess = ", it looks like metres" if 300 < times < 3000 else ""
        yield (
            "true poses put the camera inside of the objects",
            f"measured depth is about {times:.0f} times as far away: check that cam_t_m2c in scene_gt.json is in "
            f"millimetres{guess}",
        )
        return
    pairs = [(frame.seen_m, drawn) for frame in frames if (drawn := _drawn_m(frame)).any()]
    if pairs:
        yield _agreement(pairs, is_in_place)


def _drawn_m(frame: _Frame) -> Float:
    return draw_placed(frame.placed, frame.camera)[0].astype(np.float64)


def _agreement(pairs: Sequence[tuple[Float, Float]], is_in_place: bool) -> tuple[str, str]:
    """What is to be said about frames' measured and rendered depth (H, W) [m]."""
    sampled_pixels = [(seen, *_some_pixels(drawn)) for seen, drawn in pairs]
    shares = {(dx, dy): _share_near(sampled_pixels, dx, dy) for dx in SHIFTS_PX for dy in SHIFTS_PX}
    here, best = shares[0, 0], max(shares, key=lambda shift: (shares[shift], -abs(shift[0]) - abs(shift[1])))
    both = [(seen[(seen > 0) & (drawn > 0)], drawn[(seen > 0) & (drawn > 0)]) for seen, drawn in pairs]
    ratios = np.concatenate([seen / drawn for seen, drawn in both])
    ratio = float(np.median(ratios)) if len(ratios) else 1.0
    found = f"{here:.0%} of the objects' pixels lie within {NEAR_M * 1e3:.0f} mm of their true pose"
    if not 0.5 < ratio < 2:
        advice = f"measured depth is {ratio:.3g} times the true one: check depth_scale, and that poses are in mm"
    elif is_in_place and shares[best] > here + GAIN:
        advice = (
            f"{shares[best]:.0%} do if depth is displaced by {best[0]} px in x and {best[1]} px in y: "
            f"either depth is not registered to colour (warp it into the colour camera first), or {_middle(*best)}"
        )
    elif here < 0.3:
        advice = "poses, models or intrinsics do not belong to these images"
    else:
        advice = ""
    return found, advice


def _middle(dx: int, dy: int) -> str:
    """What is wrong with cam_K where that is why depth fits after a displacement [px] only."""
    off = [(name, px) for name, px in (("cx", dx), ("cy", dy)) if 4 * abs(px) > max(abs(dx), abs(dy))]
    return " and ".join(
        f"{name} of cam_K is {'at least' if abs(px) == max(SHIFTS_PX) else 'about'} {abs(px)} px too "
        f"{'large' if px > 0 else 'small'}"
        for name, px in off
    )


def _frames(dataset: BopDataset, sampled: Sequence[tuple[int, int]]) -> Iterator[_Frame]:
    for ids in sampled:
        try:
            image, truths = dataset.image(*ids), dataset.ground_truth(*ids) or ()
            known = [(t, t.T_cam_obj) for t in truths if t.obj_id in dataset.models.ids]
            placed = [Placed(t.gt_id, dataset.models.get(t.obj_id), T) for t, T in known if T is not None]
        except VerefineError:
            continue  # Said already.
        yield _Frame(image.depth_m.astype(np.float64), image.camera, tuple(placed))


def _times_as_far(frames: Sequence[_Frame]) -> float | None:
    """How often objects' true distance goes into what is measured where their origins are seen (median).

    None where most objects are in front of the camera, not around it: then rendering them says more.
    """
    placed = [(frame, one) for frame in frames for one in frame.placed]
    inside = [0 < one.T_cam_obj[2, 3] < one.model.diameter_m / 2 for _, one in placed]
    if 2 * sum(inside) <= len(inside):
        return None
    times: list[float] = []
    for (frame, one), is_inside in zip(placed, inside, strict=True):
        if is_inside:
            # Where an origin is seen does not depend on the unit of length.
            u, v = np.round(frame.camera.project(one.T_cam_obj[:3, 3])).astype(int)
            around = frame.seen_m[max(v - 5, 0) : max(v + 6, 0), max(u - 5, 0) : max(u + 6, 0)]
            measured = around[around > 0]
            if len(measured):
                times.append(float(np.median(measured)) / one.T_cam_obj[2, 3])
    return float(np.median(times)) if times else None


def _some_pixels(drawn: Float) -> tuple[Pixels, Pixels, Float]:
    """Rows, columns and depths of every seventh rendered pixel."""
    v, u = np.nonzero(drawn)
    return v[::7], u[::7], drawn[v[::7], u[::7]]


def _share_near(pairs: Sequence[tuple[Float, Pixels, Pixels, Float]], dx: int, dy: int) -> float:
    """Share of the rendered pixels whose measured depth, displaced by (dx, dy), is near the rendered one."""
    near = total = 0
    for seen, v, u, drawn in pairs:
        inside = (u - dx >= 0) & (u - dx < seen.shape[1]) & (v - dy >= 0) & (v - dy < seen.shape[0])
        measured = seen[v[inside] - dy, u[inside] - dx]
        known = measured > 0
        near += int((np.abs(measured - drawn[inside]) < NEAR_M)[known].sum())
        total += int(known.sum())
    return near / total if total else 0.0
