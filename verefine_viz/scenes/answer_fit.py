"""Whether objects appear as large as their models do in the poses that were found, where no true pose is known.

Depth holds a found pose at its distance whatever the camera is, so a wrong focal length shows in the size of outlines
as it does in true poses. But found poses move sideways with it: whether camera or models are wrong cannot be told.

Measured on eight real frames (YCB-V, 640x480) and the built-in scenes. With the right cam_K it never warned: in 160
runs, of which three quarters began 60 to 180° off, nor with masks widened or narrowed by up to 4 px. With fx and fy off
by 10% and 20% it warned in 13 and 14 of 16 runs that began 30° and 30 mm off and in a third of those that began worse;
in 1 of 8 with real estimators' poses, in the two frames with the coarsest masks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.scenes.size_fit import SURE, size_verdict, witnesses

FEWEST = 2
"""A single object may lie wrong in a way that looks larger."""


def answer_notes(answers: Sequence[tuple[ObjectModel, Float, Mask]], observation: Observation) -> tuple[str, ...]:
    """A note where the answers of a frame are all larger or smaller than their masks, as those of a wrong camera are.

    Args:
        answers: model, found T_cam_obj (4, 4) and mask (H, W) of each object.
        observation: the frame.
    """
    looked = witnesses(answers, observation.camera, observation.depth_m, observation.object_mask)
    verdict = size_verdict(looked)
    sure = [one.likeness.factor for one in looked if one.likeness.error < SURE]
    if len(sure) < FEWEST or not verdict.advice or verdict.cause == "depth":
        return ()
    factor = float(np.median(sure))
    size, off = ("larger", "small") if factor > 1 else ("smaller", "large")
    return (
        f"objects appear {abs(factor - 1):.0%} {size} than their models in the poses that were found: fx and fy of "
        f"cam_K, or the models, look too {off}; about {factor:.2f} times as much would fit",
    )
