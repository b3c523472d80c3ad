"""What of a frame's data does not fit together, where no true pose is known: told by its first poses and its answers.

Depth holds a found pose at its distance whatever the camera is, so a wrong focal length shows in the size of outlines
as it does in true poses. But found poses move sideways with it: whether camera, depth or models are wrong cannot be
told from sizes.

Sizes were measured on eight real frames (YCB-V, 640x480) and the built-in scenes. With the right cam_K they never
warned: in 160 runs, of which three quarters began 60 to 180° off, nor with masks widened or narrowed by up to 4 px.
With fx and fy off by 10% and 20% they warned in 13 and 14 of 16 runs that began 30° and 30 mm off and in a third of
those that began worse; with real estimators' poses in 2 to 14 of 30, as the masks of one of the two frames are coarse.
fx or fy alone off by 20% showed as another shape of outlines in 75 of 96 runs that began 30° and 30 mm off, and in 44
of 120 with real estimators' poses. There, what the first poses tell helps (:mod:`verefine_viz.scenes.first_fit`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.problem import Problem
from verefine_viz.scenes.first_fit import depth_notes, pull_notes
from verefine_viz.scenes.plane_gaps import plane_notes
from verefine_viz.scenes.size_fit import SURE, Witness, size_verdict, witnesses
from verefine_viz.scenes.size_words import Cause, Verdict

FEWEST = 2
"""A single object may lie wrong in a way that looks larger."""
OF_SIZE: tuple[Cause, ...] = ("focal length", "image", "models", "focal length or models", "distances")
"""What makes all objects larger or smaller; in found poses one is not told from another."""


def start_notes(problem: Problem) -> tuple[str, ...]:
    """What can be told before a run; nothing where true poses are known, which tell more."""
    return () if _has_truth(problem) else depth_notes(problem)


def answer_notes(problem: Problem, poses: Sequence[Float | None]) -> tuple[str, ...]:
    """What can be told once the run is over, the surest thing first and alone: the others follow from it.

    Args:
        problem: the frame.
        poses: found T_cam_obj (4, 4) of each target, None where there is none.
    """
    if _has_truth(problem):
        return ()
    depth = depth_notes(problem)
    if depth:
        return depth
    answers = [(t.model, T, t.instance.mask) for t, T in zip(problem.targets, poses, strict=True) if T is not None]
    seen = problem.observation
    looked = witnesses(answers, seen.camera, seen.depth_m, seen.object_mask)
    verdict = size_verdict(looked)
    if verdict.cause == "one focal length":
        return (f"{verdict.found}: {verdict.advice}",)
    return pull_notes(problem, poses) or _size_notes(looked, verdict) or plane_notes(problem, poses)


def _has_truth(problem: Problem) -> bool:
    return any(i.T_cam_obj_gt is not None for i in problem.instances)


def _size_notes(looked: Sequence[Witness], verdict: Verdict) -> tuple[str, ...]:
    """A note where the answers are all larger or smaller than their masks, as those of a wrong camera are."""
    sure = [one.likeness.factor for one in looked if one.likeness.error < SURE]
    if len(sure) < FEWEST or verdict.cause not in OF_SIZE:
        return ()
    factor = float(np.median(sure))
    size, off, depth_off = ("larger", "small", "large") if factor > 1 else ("smaller", "large", "small")
    return (
        f"objects appear {abs(factor - 1):.0%} {size} than their models in the poses that were found: fx and fy of "
        f"cam_K, or the models, look too {off} (about {factor:.2f} times as much would fit), or depth_scale too "
        f"{depth_off}",
    )
