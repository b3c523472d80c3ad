"""Whether first poses and what the sensor measured are of the same camera, where no true pose is known.

Estimators that look at colour alone place objects by the camera that they were told, and by the size of the models.
Depth that is off by a factor, or a camera that is not theirs, lies beside all of their poses in the same way, while
each by itself is off in its own. So it shows in several objects together: before a run in how far away they are, after
it in how refinement moved them, from the image's centre or towards it.

Measured on eight real frames (YCB-V, 640x480), two of them with poses of four estimators, each with ``refine``, ``rir``
and ``vf_depth``. With the right data neither said anything in 380 runs, of built-in scenes too, of which half began 60
to 180° off. With estimators' poses, fx and fy off by a factor of 0.8, 0.9, 1.1 and 1.2 were told in 29, 15, 12 and 15
of 30 runs (together with sizes in 29, 17, 24 and 16), and depth_scale off by 0.5, 0.9, 1.1 and 2 in 30, 30, 18 and 30.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem, Target
from verefine_viz.scenes.size_fit import witnesses

FEWEST = 3
"""Of fewer objects chance, or one wrong detection, may look like a rule."""
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
NOISE_PX = 3.0
"""First poses are no better than this in an image of :data:`WIDTH`, even where a few happen to agree [px]."""
MOST_NOISE_PX = 12.0
"""First poses that refinement moves in all directions by more than this are too far off to tell anything [px]."""
WIDTH = 640
"""Pixels of the image that these two are about."""
MOST_DISSENT = 0.25
"""Share of the objects that may move by less than half as much, or the other way."""


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
    error = NORMAL * float(np.median(np.abs(logs - middle))) / np.sqrt(len(logs))
    if not OFF_DEPTH + SURE * error < abs(middle) < np.log(TENFOLD):
        return ()
    ratio = float(np.exp(middle))
    return (
        f"measured depth is {_percent(ratio)} {'larger' if ratio > 1 else 'smaller'} than the first poses say: check "
        f"depth_scale in scene_camera.json (about {1 / ratio:.2f} times as much would fit), and that cam_K is that of "
        "the camera the poses were estimated for",
    )


def pull_notes(problem: Problem, poses: Sequence[Float | None]) -> tuple[str, ...]:
    """A note where refinement moved all objects away from the image's centre, or all towards it, as a wrong cam_K does.

    Args:
        problem: the frame.
        poses: found T_cam_obj (4, 4) of each target, None where there is none.
    """
    camera = problem.observation.camera
    pairs = [
        (np.median([_direction(h.T_cam_obj) for h in t.instance.hypotheses], axis=0), _direction(T))
        for t, T in zip(problem.targets, poses, strict=True)
        if T is not None and _has_first(t)
    ]
    if len(pairs) < FEWEST:
        return ()
    first, found = (np.array(side) * [camera.fx, camera.fy] for side in zip(*pairs, strict=True))
    away_px = np.linalg.norm(first, axis=1)
    if not away_px.min() > 0:
        return ()
    factors = (first * found).sum(axis=1) / away_px**2
    factor = _weighted_median(factors, away_px)
    if factor <= 0:
        return ()
    unit = camera.width / WIDTH
    noise_px = float(np.median(np.linalg.norm(found - factor * first, axis=1)))
    # Half of a deviation in the image is along the line from the centre.
    error = NORMAL * max(noise_px, NOISE_PX * unit) / np.sqrt(2 * float((away_px**2).sum()))
    dissent = np.mean((factors - 1) / (factor - 1) < 0.5) if factor != 1 else 1.0
    if noise_px > MOST_NOISE_PX * unit or abs(np.log(factor)) <= OFF_PULL + SURE * error or dissent > MOST_DISSENT:
        return ()
    away, off = ("farther from", "small") if factor > 1 else ("nearer to", "large")
    return (
        f"refinement moved the objects {_percent(factor)} {away} the image's centre than their first poses: fx and fy "
        f"of cam_K look too {off}, about {factor:.2f} times as much would fit; or the poses were estimated for another "
        "camera",
    )


def _has_first(target: Target) -> bool:
    return bool(target.instance.hypotheses)


def _direction(T_cam_obj: Float) -> Float:
    """(2,) where an object's origin is seen, as tangents of the angles to the optical axis."""
    return T_cam_obj[:2, 3] / T_cam_obj[2, 3]


def _weighted_median(values: Float, weights: Float) -> float:
    order = np.argsort(values)
    so_far = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(so_far, so_far[-1] / 2)])


def _percent(ratio: float) -> str:
    return f"{abs(ratio - 1):.0%}"
