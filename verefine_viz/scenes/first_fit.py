"""Whether first poses and what the sensor measured are of the same camera, where no true pose is known.

Estimators that look at colour alone place objects by the camera that they were told, and by the size of the models.
Depth that is off by a factor, or a camera that is not theirs, lies beside all of their poses in the same way, while
each by itself is off in its own. So it shows in several objects together: before a run in how far away they are, after
it in how refinement moved them: from the image's centre or towards it where fx and fy are wrong, one way where cx and
cy are.

Measured on eight real frames (YCB-V, 640x480), two of them with poses of four estimators, each with ``refine``, ``rir``
and ``vf_depth``. With the right data nothing was said in 432 runs, of built-in scenes too, of which 252 began 60 to
180° off. With estimators' poses, fx and fy off by a factor of 0.8, 0.9, 1.1 and 1.2 were told in 29, 15, 12 and 15 of
30 runs (together with sizes in 29, 17, 24 and 16); fx alone off by 0.8, 1.1 and 1.2, together with outlines, in 24, 18
and 26, fy alone off by 0.8, 0.9 and 1.2 in 21, 0 and 15; cx or cy off by 20 px in 9 and 17, by 40 px in 13 to 30, by 80
px in 30 (3 of 30 runs took a wrong cy for a wrong fy); depth_scale off by 0.5, 0.9, 1.1 and 2 in 30, 27, 18 and 30.
First poses 15° and 15 mm off told cx or cy off by 40 px in 7 of 32 runs, those 30° and 30 mm off never.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem, Target
from verefine_viz.scenes.size_fit import witnesses
from verefine_viz.scenes.size_words import middle_off, percent, sideways

FEWEST = 3
"""Of fewer objects chance, or one wrong detection, may look like a rule."""
FEWEST_ALONG = 4
"""The same where a rule is about one axis alone."""
SURE = 3.0
"""What is off must be so by this many times what it is uncertain by."""
NORMAL = 1.85
"""Median deviation of several values to the uncertainty of their median, times the root of their number."""
OFF_DEPTH = 0.05
"""Estimators' own distances may all be off by this share."""
TENFOLD = 5.0
"""What is off by more than this factor is of another unit, and said where units are looked at."""
OFF_PULL = 0.03
"""Distances to the image's centre may all change by this share in refinement."""
OFF_PLACE_PX = 8.0
"""All objects may move by so much in the image, of :data:`WIDTH` [px]."""
CHANCE = 2
"""As many objects happen to agree in their depth, in one way or along one axis: they count for nothing."""
NOISE_PX = 3.0
"""First poses are no better than this in an image of :data:`WIDTH`, even where a few happen to agree [px]."""
MOST_NOISE_PX = 12.0
"""First poses that refinement moves in all directions by more than this are too far off to tell anything [px]."""
WIDTH = 640
"""Pixels of the image that these three are about."""
MOST_DISSENT = 0.25
"""Share of the objects that may move by less than half as much, or another way."""


def depth_notes(problem: Problem) -> tuple[str, ...]:
    """A note where all objects are measured nearer, or all farther away, than their first poses say."""
    posed = [(t.model, t.instance.hypotheses[0].T_cam_obj, t.instance.mask) for t in problem.targets if _has_first(t)]
    seen = problem.observation
    looked = witnesses(posed, seen.camera, seen.depth_m, seen.object_mask)
    depths = np.array([one.likeness.depth for one in looked])
    logs = np.log(depths[np.isfinite(depths) & (depths > 0)])
    if len(logs) < FEWEST:
        return ()
    middle = float(np.median(logs))
    error = NORMAL * float(np.median(np.abs(logs - middle))) / np.sqrt(len(logs) - CHANCE)
    if not OFF_DEPTH + SURE * error < abs(middle) < np.log(TENFOLD):
        return ()
    ratio = float(np.exp(middle))
    return (
        f"measured depth is {percent(ratio)} {'larger' if ratio > 1 else 'smaller'} than the first poses say: check "
        f"depth_scale in scene_camera.json (about {1 / ratio:.2f} times as much would fit), and that cam_K is that of "
        "the camera the poses were estimated for",
    )


def pull_notes(problem: Problem, poses: Sequence[Float | None]) -> tuple[str, ...]:
    """A note where refinement moved all objects from the image's centre or towards it, or all the same way.

    The one is what wrong fx and fy do, the other what wrong cx and cy do; where both would explain it, the better one
    is named.

    Args:
        problem: the frame.
        poses: found T_cam_obj (4, 4) of each target, None where there is none.
    """
    camera = problem.observation.camera
    focal = np.array([camera.fx, camera.fy])
    pairs = [
        (focal * [_direction(h.T_cam_obj) for h in t.instance.hypotheses], focal * _direction(T))
        for t, T in zip(problem.targets, poses, strict=True)
        if T is not None and _has_first(t)
    ]
    if len(pairs) < FEWEST:
        return ()
    moved = _Moved(
        first_px=np.array([np.median(firsts, axis=0) for firsts, _ in pairs]),
        found_px=np.array([found for _, found in pairs]),
        scatter_px=float(np.median([_spread_px(firsts, np.median(firsts, axis=0)) for firsts, _ in pairs])),
        unit=camera.width / WIDTH,
    )
    causes = [_pulled(moved, (1, 1)), _displaced(moved)]
    if causes[1] is None and len(pairs) >= FEWEST_ALONG:
        # Along one axis alone a factor does nearly what a displacement does, where objects are on one side.
        causes += [_pulled(moved, (1, 0)), _pulled(moved, (0, 1))]
    told = sorted((one for one in causes if one is not None), key=lambda one: one.left_px)
    return tuple(one.note for one in told[:1])


@dataclass(frozen=True, eq=False)
class _Moved:
    """Where objects were seen before and after refinement."""

    first_px: Float
    """(N, 2) from the image's centre, in the middle of an object's first poses."""
    found_px: Float
    """(N, 2) from the image's centre."""
    scatter_px: float
    """How far apart an object's own first poses are; 0 of a single one."""
    unit: float
    """Pixels per pixel of an image of :data:`WIDTH`."""

    def noise_px(self, left_px: float) -> float:
        """How far off first poses are, where objects lie ``left_px`` beside an explanation (median)."""
        return max(left_px, self.scatter_px, NOISE_PX * self.unit)

    def error_px(self, left_px: float, extra: int = 0) -> float:
        """What the median of all but ``extra`` is uncertain by, along one direction: half of a deviation is across."""
        return NORMAL * self.noise_px(left_px) / np.sqrt(2 * (len(self.first_px) - extra))


@dataclass(frozen=True)
class _Told:
    """One explanation."""

    note: str
    left_px: float
    """How far beside it objects still lie."""


def _pulled(moved: _Moved, axes: tuple[int, int]) -> _Told | None:
    """All farther from the image's centre by one factor, or nearer, along the ``axes`` that are 1."""
    first, found = moved.first_px * axes, moved.found_px
    away_px = np.linalg.norm(first, axis=1)
    if not away_px.min() > 0:
        return None
    factors = (first * found).sum(axis=1) / away_px**2
    factor = _weighted_median(factors, away_px)
    if factor <= 0:
        return None
    left_px = _spread_px(found, moved.first_px + (factor - 1) * first)
    noise_px = moved.noise_px(left_px)
    error = moved.error_px(left_px, 0 if all(axes) else CHANCE) / float(np.sqrt((away_px**2).mean()))
    dissent = np.mean((factors - 1) / (factor - 1) < 0.5) if factor != 1 else 1.0
    is_chance = abs(np.log(factor)) <= OFF_PULL + SURE * error or dissent > MOST_DISSENT
    if noise_px > MOST_NOISE_PX * moved.unit or is_chance:
        return None
    away, off = ("farther from", "small") if factor > 1 else ("nearer to", "large")
    what = {(1, 1): "fx and fy of cam_K look", (1, 0): "fx of cam_K looks", (0, 1): "fy of cam_K looks"}[axes]
    along = {(1, 1): "", (1, 0): " sideways", (0, 1): " up and down"}[axes]
    return _Told(
        f"refinement moved the objects {percent(factor)} {away} the image's centre{along} than their first poses: "
        f"{what} too {off}, about {factor:.2f} times as much would fit; or the poses were estimated for another camera",
        left_px,
    )


def _displaced(moved: _Moved) -> _Told | None:
    """All by the same way in the image."""
    ways_px = moved.found_px - moved.first_px
    way_px = np.median(ways_px, axis=0)
    far_px, left_px = float(np.linalg.norm(way_px)), _spread_px(ways_px, way_px)
    noise_px, error_px = moved.noise_px(left_px), moved.error_px(left_px, CHANCE)
    dissent = np.mean(np.linalg.norm(ways_px - way_px, axis=1) > far_px / 2)
    is_chance = far_px <= OFF_PLACE_PX * moved.unit + SURE * error_px or dissent > MOST_DISSENT
    if noise_px > MOST_NOISE_PX * moved.unit or is_chance:
        return None
    moves = sideways(way_px, (("left", "right"), ("up", "down")))
    return _Told(
        f"refinement moved all objects {moves} in the image from their first poses: {middle_off(way_px)}; check that "
        "cam_K belongs to these images, also if they were cropped; or the poses were estimated for another camera",
        left_px,
    )


def _spread_px(places_px: Float, of_px: Float) -> float:
    """How far places (N, 2) are from those they are expected at (median)."""
    return float(np.median(np.linalg.norm(places_px - of_px, axis=1)))


def _has_first(target: Target) -> bool:
    return bool(target.instance.hypotheses)


def _direction(T_cam_obj: Float) -> Float:
    """(2,) where an object's origin is seen, as tangents of the angles to the optical axis."""
    return T_cam_obj[:2, 3] / T_cam_obj[2, 3]


def _weighted_median(values: Float, weights: Float) -> float:
    order = np.argsort(values)
    so_far = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(so_far, so_far[-1] / 2)])
