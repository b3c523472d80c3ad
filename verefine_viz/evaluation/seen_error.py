"""How far a pose is from those that an image allows: right as far as the image shows.

Symmetries are those of one image, as in BOP-Distrib (Vayssade et al.): a mug whose handle is hidden has one there.
"""

from __future__ import annotations

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.model import ObjectModel
from verefine_viz.evaluation.allowed_poses import AllowedPoses
from verefine_viz.evaluation.pose_errors import add_s_mm


def nearest_allowed(allowed: AllowedPoses, model: ObjectModel, T_cam_obj: Float) -> tuple[Float, float]:
    """The allowed pose next to a pose (4, 4), and how far away it is by ADD(-S) [mm].

    Of the allowed poses the anchors are looked at: small motions away from them are not.
    """
    errors = [add_s_mm(model, T, T_cam_obj) for T in allowed.anchors]
    k = int(np.argmin(errors))
    return allowed.anchors[k], errors[k]


def is_allowed(allowed: AllowedPoses, model: ObjectModel, T_cam_obj: Float) -> bool:
    """Whether a pose (4, 4) is among the allowed ones: a small motion away from the anchor next to it."""
    anchor, _ = nearest_allowed(allowed, model, T_cam_obj)
    small = allowed.small
    motions = [small.six.motion_to(T_cam_obj @ S, anchor) for S in model.symmetries]
    # The likeliest motion is that from the answer itself.
    return any(small.allow(motion - small.offset) or small.allow(motion) for motion in motions)
